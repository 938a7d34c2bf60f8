"""What is written into a drive at boot-up."""

from __future__ import annotations

import dataclasses
import struct

import pytest
from canopen.objectdictionary import ObjectDictionary

from mcserver.can.pdo_layout import RPDO1, RPDO2, TPDO1, TPDO2, Mode, Pdo
from mcserver.canopen.configuration import (
    SdoWrite,
    configuration_writes,
    interpolation_period,
)
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.eds import parse_description
from mcserver.canopen.settings import DriveSettings, settings_of
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import parse_machine

NODE = 3
MASTER = 127
DRIVE = DriveSettings(axis=2, kind="cia402", bus="can0", address="can0", node=NODE)


def writes(
    drive: DriveSettings = DRIVE, cycle_s: float = 0.002, dictionary: ObjectDictionary | None = None
) -> list[SdoWrite]:
    return configuration_writes(drive, cycle_s, dictionary or generic_dictionary(NODE), MASTER)


def with_(**values: object) -> DriveSettings:
    return dataclasses.replace(DRIVE, **values)  # type: ignore[arg-type]


def of(index: int, found: list[SdoWrite]) -> list[tuple[int, int]]:
    """(subindex, value) of what is written to one object, in order."""
    return [
        (write.subindex, int.from_bytes(write.payload, "little")) for write in found if write.index == index
    ]


def test_a_pdo_is_invalidated_emptied_mapped_and_made_valid_in_this_order() -> None:
    rpdo = [write for write in writes() if write.index in (0x1400, 0x1600)]
    assert [(write.index, write.subindex) for write in rpdo] == [
        (0x1400, 1),
        (0x1600, 0),
        (0x1600, 1),
        (0x1600, 2),
        (0x1600, 3),
        (0x1600, 0),
        (0x1400, 2),
        (0x1400, 5),
        (0x1400, 1),
    ]
    cobs = of(0x1400, writes())
    assert cobs[0] == (1, 0x80000203)
    assert cobs[-1] == (1, 0x203)


@pytest.mark.parametrize("pdo", [RPDO1, RPDO2, TPDO1])
def test_with_torques_the_mapping_is_that_of_the_layout(pdo: Pdo) -> None:
    first, bit30 = (0x1600, 0) if pdo in (RPDO1, RPDO2) else (0x1A00, 1 << 30)
    found = writes(with_(torque=True))
    mapping = of(first + pdo.number - 1, found)
    entries = [mapped.word for mapped in pdo.objects]
    assert mapping == [(0, 0), *enumerate(entries, 1), (0, len(entries))]
    last = of(first - 0x200 + pdo.number - 1, found)[-1]
    assert last[1] & 0x8000_0000 == 0
    assert last[1] & (1 << 30) == bit30


def test_transmission_types_are_those_of_the_layout() -> None:
    assert (2, RPDO1.transmission) in of(0x1400, writes())
    assert (2, TPDO2.transmission) in of(0x1801, writes(with_(torque=True)))


@pytest.mark.parametrize("index", [0x1402, 0x1403, 0x1802, 0x1803])
def test_pdos_that_are_not_used_are_switched_off(index: int) -> None:
    found = of(index, writes())
    assert len(found) == 1
    assert found[0][1] & 0x8000_0000


def test_only_the_first_rpdo_is_watched_because_the_second_stays_out_in_position_mode() -> None:
    found = writes(with_(command_timeout_ms=120))
    assert (5, 120) in of(0x1400, found)
    assert (5, 0) in of(0x1401, found)


def test_heartbeats_go_both_ways() -> None:
    found = writes(with_(heartbeat_ms=50))
    assert of(0x1017, found) == [(0, 50)]
    assert of(0x1016, found) == [(1, 127 << 16 | 1000)]


def test_a_silent_master_lets_the_drive_stop_quickly() -> None:
    assert of(0x6007, writes()) == [(0, 3)]


@pytest.mark.parametrize(
    ("cycle_hz", "period"),
    [
        (1000.0, (1, -3)),
        (500.0, (2, -3)),
        (250.0, (4, -3)),
        (400.0, (25, -4)),
        (125.0, (8, -3)),
        (100.0, (10, -3)),
        (10.0, (100, -3)),
        (1.0, (100, -2)),
    ],
)
def test_the_interpolation_time_is_the_cycle_in_milliseconds_where_it_can_be(
    cycle_hz: float, period: tuple[int, int]
) -> None:
    assert interpolation_period(1.0 / cycle_hz) == period
    found = writes(cycle_s=1.0 / cycle_hz)
    assert of(0x60C2, found) == [(1, period[0]), (2, period[1] & 0xFF)]


def test_a_cycle_that_60c2_cannot_say_is_refused_with_those_that_it_can() -> None:
    with pytest.raises(ConfigurationError, match=r"MC552.*4\.16667 ms.*250"):
        interpolation_period(1.0 / 240.0)


@pytest.mark.parametrize("mode", [Mode.CYCLIC_POSITION, Mode.CYCLIC_VELOCITY])
def test_the_mode_is_set_before_the_start(mode: Mode) -> None:
    assert of(0x6060, writes(with_(mode=mode))) == [(0, mode)]


def test_a_machine_file_gives_scaling_identity_and_writes_of_its_own() -> None:
    machine = parse_machine(
        """
[machine]
name = "m"
cycle_hz = 200
[[bus]]
name = "left"
address = "socketcand:127.0.0.1:2000/can0"
[[axis]]
index = 2
type = "linear"
max_velocity = 100
max_acceleration = 1000
[axis.drive]
kind = "cia402"
bus = "left"
node = 3
encoder = [4096, 1]
gear = [5, 2]
feed = [10, 1]
vendor_id = 0x11
sdo_writes = [[0x6065, 0, 500], [0x2000, 1, -2, 4]]
"""
    )
    (drive,) = settings_of(machine)
    assert (drive.axis, drive.address, drive.vendor_id) == (2, "socketcand:127.0.0.1:2000/can0", 0x11)
    found = configuration_writes(drive, machine.cycle_s, generic_dictionary(3), MASTER)
    assert of(0x608F, found) == [(1, 4096), (2, 1)]
    assert of(0x6091, found) == [(1, 5), (2, 2)]
    assert of(0x6092, found) == [(1, 4096 * 5), (2, 2)]
    assert [(write.index, write.payload) for write in found[-2:]] == [
        (0x6065, struct.pack("<I", 500)),
        (0x2000, struct.pack("<i", -2)),
    ]


def test_values_of_a_dcf_are_written_first_but_for_those_of_communication() -> None:
    text = (
        "[6065]\nParameterName=Window\nDataType=7\nAccessType=rw\nParameterValue=77\n"
        "[6064]\nParameterName=Position\nDataType=4\nAccessType=ro\nPDOMapping=1\nParameterValue=1\n"
        "[1017]\nParameterName=Heartbeat\nDataType=6\nAccessType=rw\nParameterValue=9\n"
    )
    dictionary = parse_description(text, NODE).dictionary
    generic = generic_dictionary(NODE)
    for index in generic:
        if index not in dictionary:
            dictionary.add_object(generic[index])
    found = writes(dictionary=dictionary)
    assert (found[0].index, found[0].payload) == (0x6065, struct.pack("<I", 77))
    assert of(0x6064, found) == []
    assert of(0x1017, found) == [(0, 100)]


@pytest.mark.parametrize("index", [0x1600, 0x6040, 0x6041, 0x607A, 0x6060, 0x6064, 0x1017])
def test_an_eds_without_a_needed_object_is_refused_with_its_index(index: int) -> None:
    dictionary = generic_dictionary(NODE)
    del dictionary.indices[index]
    with pytest.raises(ConfigurationError, match=rf"MC552: axis 2, node 3 on can0: {index:04X}h"):
        writes(dictionary=dictionary)


@pytest.mark.parametrize("index", [0x1016, 0x6007, 0x60C2, 0x1403, 0x1802])
def test_an_eds_without_an_optional_object_is_as_good(index: int) -> None:
    dictionary = generic_dictionary(NODE)
    del dictionary.indices[index]
    assert of(index, writes(dictionary=dictionary)) == []


@pytest.mark.parametrize("what", ["mapping", "identifier"])
def test_a_pdo_that_is_fixed_is_taken_where_it_is_the_right_one(what: str) -> None:
    dictionary = generic_dictionary(NODE)
    mapping = dictionary[0x1600]
    if what == "mapping":
        for member in mapping.values():
            member.access_type = "const"
    else:
        # a PDO that cannot be switched off cannot be mapped either
        dictionary[0x1400][1].access_type = "ro"
    with pytest.raises(ConfigurationError, match=r"MC552.*1600h:00.*RPDOs cannot be mapped"):
        writes(dictionary=dictionary)
    mapping[0].default = 3
    for at, entry in enumerate(RPDO1.objects, 1):
        mapping[at].default = entry.word
    found = [write for write in writes(dictionary=dictionary) if write.index == 0x1600]
    assert found
    assert all(write.verify for write in found)


@pytest.mark.parametrize("index", [0x1600, 0x1400, 0x6040, 0x608F, 0x1017, 0x60C2])
def test_own_writes_must_not_undo_what_the_server_arranges(index: int) -> None:
    with pytest.raises(ConfigurationError, match=r"MC552.*sdo_writes"):
        writes(with_(sdo_writes=((index, 1, 0),)))


def test_own_writes_that_do_not_fit_are_refused() -> None:
    for write in ((0x6060, 0, 1), (0x6073, 0, 70000), (0x6073, 0, 70000, 2), (0x2345, 0, 1)):
        with pytest.raises(ConfigurationError, match=r"MC552"):
            writes(with_(sdo_writes=(write,)))
