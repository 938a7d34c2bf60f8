"""The torque that a motion needs goes to the drive with the targets: 60B2h, in thousandths of 6076h."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from mcserver.can.cob import Function
from mcserver.canopen.configuration import configure
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.settings import settings_of
from mcserver.drives.bus import DriveMode
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import parse_machine
from tests.drives.can_rig import Bench, machine
from tests.machine_text import axes_text

FED = "torque_feed_forward = true"


def offsets(bench: Bench) -> list[int]:
    """What 60B2h of node 1 was given, one value a frame."""
    return [
        struct.unpack("<h", payload)[0]
        for identifier, payload in bench.port.sent
        if identifier == Function.RPDO3 + 1
    ]


def energized(drive: str = FED) -> Bench:
    bench = Bench(machine(1, drive=drive), (1000,))
    bench.tell(DriveMode.POSITION)
    bench.setpoints.torque[:] = 1.0
    bench.exchange(20)
    return bench


@pytest.mark.parametrize("mode", ["csp", "csv"])
def test_torque_goes_along_with_every_setpoint_in_thousandths_of_the_rated_torque(mode: str) -> None:
    bench = energized(f'{FED}\nmode = "{mode}"')
    bench.port.sent.clear()
    for newton_metres in (0.5, -0.25):
        bench.setpoints.torque[:] = newton_metres
        bench.exchange()
    assert offsets(bench) == [250, -125]


def test_a_motor_that_turns_against_its_axis_gets_the_torque_with_the_other_sign() -> None:
    bench = energized(f"{FED}\ninvert = true")
    assert offsets(bench)[-1] == -500


def test_no_torque_goes_out_before_the_drive_is_found_energized_nor_after() -> None:
    bench = energized()
    assert 500 in offsets(bench)
    assert offsets(bench)[0] == 0
    before = offsets(bench).index(500)
    controlwords = [
        payload[:2] for identifier, payload in bench.port.sent if identifier == Function.RPDO1 + 1
    ]
    assert controlwords.index(b"\x0f\x00") <= before
    bench.tell(DriveMode.OFF)
    bench.port.sent.clear()
    bench.exchange(3)
    assert set(offsets(bench)) == {0}


def test_the_command_of_torque_mode_is_not_added_a_second_time() -> None:
    bench = energized()
    bench.tell(DriveMode.TORQUE)
    bench.setpoints.torque[:] = 0.4
    bench.port.sent.clear()
    bench.exchange(5)
    assert set(offsets(bench)) == {0}
    assert bench.drives[0].torque == 200


@pytest.mark.parametrize(("value", "sent"), [(np.nan, 0), (np.inf, 0), (1e9, 32767), (-1e9, -32767)])
def test_a_torque_that_is_no_number_is_sent_as_nothing_and_too_much_as_the_most(
    value: float, sent: int
) -> None:
    bench = energized()
    bench.setpoints.torque[:] = value
    bench.exchange(2)
    assert offsets(bench)[-1] == sent


def test_without_the_key_nothing_of_it_is_mapped_or_sent() -> None:
    bench = energized("")
    assert offsets(bench) == []
    [settings] = settings_of(machine(1))
    _, planned = configure(settings, 0.001, generic_dictionary(1), 127)
    assert 0x60B2 not in {each.index for pdo in planned.process_data.rpdos for each in pdo.objects}


def test_the_drive_gets_an_rpdo_for_it_without_a_time_out() -> None:
    [settings] = settings_of(machine(1, drive=FED))
    writes, planned = configure(settings, 0.001, generic_dictionary(1), 127)
    [pdo] = [pdo for pdo in planned.process_data.rpdos if pdo.objects[0].index == 0x60B2]
    record = 0x1400 + pdo.number - 1
    assert [each.payload for each in writes if (each.index, each.subindex) == (record, 5)] == [b"\0\0"]
    assert pdo.transmission == 1


def test_a_drive_without_torque_offset_is_refused_with_the_key_to_change() -> None:
    dictionary = generic_dictionary(1)
    del dictionary.indices[0x60B2]
    [settings] = settings_of(machine(1, drive=FED))
    with pytest.raises(ConfigurationError, match="60B2h") as refused:
        configure(settings, 0.001, dictionary, 127)
    assert refused.value.code == "MC552"
    assert "torque_feed_forward = false" in (refused.value.hint or "")


def test_feed_forward_needs_the_rated_torque() -> None:
    drive = f'bus = "can0"\nnode = 1\ncounts_per_motor_rev = 1000\n{FED}'
    with pytest.raises(ConfigurationError, match="rated torque"):
        parse_machine(f'[machine]\nname = "m"\n{axes_text(rotary=True, drive="cia402", drive_keys=drive)}')
