"""mode = "cst" at boot-up: what is mapped and written, and which drives are refused."""

from __future__ import annotations

import pytest

from mcserver.can.pdo_layout import Mode
from mcserver.canopen.configuration import configure
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.process_data import PlannedProcessData
from mcserver.canopen.sdo_write import SdoWrite
from mcserver.canopen.settings import settings_of
from mcserver.drives.bus import DriveMode
from mcserver.errors import ConfigurationError
from tests.drives.can_rig import machine
from tests.drives.torque_drive import torque_machine


def configured(drive: str = "", *without: int) -> tuple[list[SdoWrite], PlannedProcessData]:
    dictionary = generic_dictionary(1)
    for index in without:
        del dictionary.indices[index]
    [settings] = settings_of(torque_machine(drive))
    return configure(settings, 0.001, dictionary, 127)


def objects(planned: PlannedProcessData) -> list[list[int]]:
    return [[each.index for each in pdo.objects] for pdo in planned.process_data.rpdos]


def test_target_torque_is_mapped_and_never_given_up() -> None:
    writes, planned = configured()
    assert objects(planned) == [[0x6040, 0x6060, 0x607A], [0x6040, 0x60FF, 0x6071]]
    assert planned.spare == {name: pdo for name, pdo in planned.spare.items() if name.startswith("TPDO")}
    [mode] = [write for write in writes if write.index == 0x6060]
    assert mode.payload == bytes([Mode.CYCLIC_TORQUE])


def test_a_drive_with_torques_alone_gets_them_beside_controlword_and_mode() -> None:
    _, planned = configured("", 0x607A, 0x60FF)
    assert objects(planned) == [[0x6040, 0x6060, 0x6071]]


@pytest.mark.parametrize(("mode", "target"), [("cst", 0x6071), ("csv", 0x60FF)])
def test_a_drive_whose_mode_is_not_in_its_process_data_gets_its_target_all_the_same(
    mode: str, target: int
) -> None:
    dictionary = generic_dictionary(1)
    dictionary[0x6060].pdo_mappable = False
    described = torque_machine() if mode == "cst" else machine(1, drive='mode = "csv"')
    [settings] = settings_of(described)
    _, planned = configure(settings, 0.001, dictionary, 127)
    assert any(0x6040 in pdo and target in pdo for pdo in objects(planned))


def test_only_the_rpdo_that_goes_out_in_every_mode_is_watched() -> None:
    writes, _ = configured()
    timeouts = {each.index: each.payload for each in writes if each.subindex == 5}
    assert timeouts == {0x1400: b"\x14\x00", 0x1401: b"\x00\x00"}


def test_a_drive_without_target_torque_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="6071h") as refused:
        configured("", 0x6071)
    assert refused.value.code == "MC552"


def test_a_drive_without_the_mode_is_refused_with_those_that_it_has() -> None:
    dictionary = generic_dictionary(1)
    [settings] = settings_of(torque_machine())
    dictionary[0x6502].default = 1 << 7 | 1 << 0
    with pytest.raises(ConfigurationError, match="no cyclic synchronous torque") as refused:
        configure(settings, 0.001, dictionary, 127)
    assert 'mode = "csp"' in (refused.value.hint or "")


def test_the_greatest_torque_is_written_only_where_the_machine_file_says_it() -> None:
    assert not [each for each in configured()[0] if each.index == 0x6072]
    [write] = [each for each in configured("max_torque = 3.0")[0] if each.index == 0x6072]
    assert int.from_bytes(write.payload, "little") == 1500


def test_feed_forward_goes_with_the_target_and_needs_no_object_of_its_own() -> None:
    _, planned = configured("torque_feed_forward = true", 0x60B2)
    assert all(0x60B2 not in pdo for pdo in objects(planned))


def test_torque_commands_need_no_change_of_mode() -> None:
    drive = torque_machine().axes[0].drive
    assert drive.has_mode(DriveMode.TORQUE)
    assert drive.has_mode(DriveMode.POSITION)
