"""Process data of the simulated drive: the rules of mapping, transmission types, lengths and timers."""

from __future__ import annotations

import struct

import pytest

from mcserver.can.cob import SYNC, Function, NmtCommand
from mcserver.drive_sim.pdo import INVALID
from tests.drive_sim.bench import (
    ENABLE,
    ENABLED,
    FAULT,
    NODE,
    QUICK_STOPPED,
    SHUTDOWN,
    SWITCH_ON_DISABLED,
    Aborted,
    Bench,
)

TPDO3 = Function.TPDO3 + NODE
STATUSWORD = 0x60410010
POSITION = 0x60640020
TARGET = 0x607A0020
CONTROLWORD = 0x60400010
ERROR_REGISTER = 0x10010008


@pytest.fixture
def bench() -> Bench:
    return Bench().boot()


def abort_of(bench: Bench, index: int, subindex: int, packing: str, value: int) -> int:
    with pytest.raises(Aborted) as aborted:
        bench.write(index, subindex, packing, value)
    code: int = aborted.value.args[0]
    return code


def map_third(bench: Bench, kind: int, *objects: int, event_ms: int = 0, inhibit: int = 0) -> None:
    """TPDO3 with these objects and this transmission type; the node is started."""
    bench.write(0x1802, 1, "I", TPDO3 | INVALID)
    bench.write(0x1A02, 0, "B", 0)
    for subindex, mapped in enumerate(objects, start=1):
        bench.write(0x1A02, subindex, "I", mapped)
    bench.write(0x1A02, 0, "B", len(objects))
    bench.write(0x1802, 2, "B", kind)
    bench.write(0x1802, 3, "H", inhibit)
    bench.write(0x1802, 5, "H", event_ms)
    bench.write(0x1802, 1, "I", TPDO3)
    bench.nmt(NmtCommand.START)


# ---------------------------------------------------------------------- rules of mapping


@pytest.mark.parametrize("index", [0x1600, 0x1A00])
def test_a_mapping_is_changed_only_while_its_pdo_is_invalid(bench: Bench, index: int) -> None:
    assert abort_of(bench, index, 0, "B", 0) == 0x06010000
    assert abort_of(bench, index, 1, "I", STATUSWORD) == 0x06010000


@pytest.mark.parametrize("index", [0x1601, 0x1A01])
def test_a_mapping_is_changed_only_while_its_count_is_0(bench: Bench, index: int) -> None:
    mapped = TARGET if index < 0x1A00 else POSITION
    assert abort_of(bench, index, 1, "I", mapped) == 0x06010000
    bench.write(index, 0, "B", 0)
    bench.write(index, 1, "I", mapped)
    bench.write(index, 0, "B", 1)
    assert bench.read(index, 1, "I") == mapped


@pytest.mark.parametrize(
    ("mapped", "code"),
    [
        (0x20000010, 0x06020000),
        (0x60410110, 0x06090011),
        (0x60410020, 0x06040041),
        (0x608F0120, 0x06040041),
        (0x60400010, 0x06040041),
    ],
)
def test_what_cannot_be_mapped_into_a_tpdo_is_refused(bench: Bench, mapped: int, code: int) -> None:
    bench.write(0x1A01, 0, "B", 0)
    assert abort_of(bench, 0x1A01, 1, "I", mapped) == code


def test_a_value_that_is_only_reported_cannot_be_received(bench: Bench) -> None:
    bench.write(0x1601, 0, "B", 0)
    assert abort_of(bench, 0x1601, 1, "I", STATUSWORD) == 0x06040041


def test_more_than_8_bytes_are_no_mapping(bench: Bench) -> None:
    bench.write(0x1A01, 0, "B", 0)
    for subindex, mapped in enumerate((POSITION, POSITION, ERROR_REGISTER), start=1):
        bench.write(0x1A01, subindex, "I", mapped)
    assert abort_of(bench, 0x1A01, 0, "B", 3) == 0x06040042
    assert abort_of(bench, 0x1A01, 0, "B", 9) == 0x06090030
    bench.write(0x1A01, 0, "B", 2)


def test_the_cob_id_of_a_valid_pdo_does_not_change(bench: Bench) -> None:
    assert abort_of(bench, 0x1800, 1, "I", 0x190) == 0x08000022
    bench.write(0x1800, 1, "I", 0x190 | INVALID)
    bench.write(0x1800, 1, "I", 0x190)
    bench.nmt(NmtCommand.START)
    assert len(bench.taken(0x190)) == 1


@pytest.mark.parametrize("identifier", [0x000, 0x080, 0x101, 0x585, 0x605, 0x705, 0x20000185])
def test_cob_ids_of_other_services_are_refused(bench: Bench, identifier: int) -> None:
    bench.write(0x1800, 1, "I", INVALID | 0x185)
    assert abort_of(bench, 0x1800, 1, "I", identifier) == 0x06090030


def test_reserved_transmission_types_are_refused(bench: Bench) -> None:
    for kind in (241, 252, 253):
        assert abort_of(bench, 0x1800, 2, "B", kind) == 0x06090030


def test_dummy_objects_make_room_in_an_rpdo() -> None:
    bench = Bench().boot()
    bench.write(0x1400, 1, "I", INVALID | 0x205)
    bench.write(0x1600, 0, "B", 0)
    for subindex, mapped in enumerate((0x00050008, CONTROLWORD), start=1):
        bench.write(0x1600, subindex, "I", mapped)
    bench.write(0x1600, 0, "B", 2)
    bench.write(0x1400, 1, "I", 0x205)
    bench.nmt(NmtCommand.START)
    bench.receive(0x205, b"\xff\x06\x00")
    assert bench.read(0x6040, 0, "H") == SHUTDOWN


# ---------------------------------------------------------------------- TPDOs


def test_a_tpdo_of_type_n_comes_with_every_nth_sync(bench: Bench) -> None:
    map_third(bench, 3, STATUSWORD)
    came = []
    for _ in range(9):
        bench.receive(SYNC)
        came.append(len(bench.taken(TPDO3)))
    assert came == [0, 0, 1] * 3


def test_a_tpdo_of_type_0_comes_with_the_sync_after_a_change(bench: Bench) -> None:
    map_third(bench, 0, STATUSWORD)
    came = []
    for controlword in (0, 0, SHUTDOWN, SHUTDOWN, 0):
        bench.write(0x6040, 0, "H", controlword)
        bench.receive(SYNC)
        came.append(len(bench.taken(TPDO3)))
    assert came == [1, 0, 1, 0, 1]


def test_an_event_driven_tpdo_comes_at_once_on_change_and_at_the_start(bench: Bench) -> None:
    map_third(bench, 255, STATUSWORD)
    assert len(bench.taken(TPDO3)) == 1
    bench.wait(1.0)
    assert bench.taken(TPDO3) == []
    bench.write(0x6040, 0, "H", SHUTDOWN)
    assert [struct.unpack("<H", payload)[0] & 0x6F for payload in bench.taken(TPDO3)] == [0x21]


def test_an_event_timer_repeats_a_tpdo(bench: Bench) -> None:
    map_third(bench, 254, STATUSWORD, event_ms=20)
    bench.taken()
    bench.wait(1.0)
    assert len(bench.taken(TPDO3)) == 50


def test_an_inhibit_time_holds_changes_back(bench: Bench) -> None:
    map_third(bench, 255, STATUSWORD, inhibit=1000)
    bench.wait(0.2)
    bench.taken()
    for controlword in (SHUTDOWN, 0, SHUTDOWN):
        bench.write(0x6040, 0, "H", controlword)
    assert len(bench.taken(TPDO3)) == 1
    bench.wait(0.09)
    assert bench.taken(TPDO3) == []
    bench.write(0x6040, 0, "H", 0)
    bench.wait(0.02)
    assert len(bench.taken(TPDO3)) == 1


def test_another_sync_object_is_listened_to_once_it_is_written(bench: Bench) -> None:
    map_third(bench, 1, STATUSWORD)
    bench.write(0x1005, 0, "I", 0x81)
    assert 0x81 in bench.node.identifiers()
    bench.receive(SYNC)
    assert bench.taken(TPDO3) == []
    bench.receive(0x81)
    assert len(bench.taken(TPDO3)) == 1


# ---------------------------------------------------------------------- RPDOs


def test_synchronous_values_act_at_the_sync_and_the_newest_counts() -> None:
    bench = Bench().operate()
    for target in (100, 200):
        bench.receive(Function.RPDO1 + NODE, struct.pack("<Hbi", 0, 8, target))
        assert bench.read(0x607A, 0, "i") == 0
    bench.receive(SYNC)
    assert bench.read(0x607A, 0, "i") == 200


def test_event_driven_values_act_at_once(bench: Bench) -> None:
    bench.nmt(NmtCommand.START)
    bench.receive(Function.RPDO1 + NODE, struct.pack("<H", SHUTDOWN))
    assert bench.state == 0x21


@pytest.mark.parametrize(("length", "code", "target"), [(6, 0x8210, 0), (8, 0x8220, 77)])
def test_a_pdo_of_a_wrong_length_is_reported_and_processed_where_it_is_too_long(
    length: int, code: int, target: int
) -> None:
    bench = Bench().operate()
    bench.receive(Function.RPDO1 + NODE, struct.pack("<Hbib", 0, 8, 77, 1)[:length])
    bench.receive(SYNC)
    assert bench.emergencies() == [code, 0x0000]
    assert bench.read(0x607A, 0, "i") == target


@pytest.mark.parametrize(
    ("option", "states"),
    [(0, {ENABLED}), (1, {FAULT}), (2, {SWITCH_ON_DISABLED}), (3, {QUICK_STOPPED, SWITCH_ON_DISABLED})],
)
def test_a_silent_master_is_noticed_by_the_event_timer(option: int, states: set[int]) -> None:
    bench = Bench().operate()
    bench.write(0x1400, 5, "H", 50)
    bench.write(0x6007, 0, "h", option)
    bench.enable()
    bench.cycles(100, ENABLE)
    assert bench.emergencies() == []
    for _ in range(20):
        bench.wait(0.005)
        bench.receive(SYNC)
    assert bench.emergencies() == [0x8250]
    assert bench.state in states


def test_the_end_of_the_silence_is_reported() -> None:
    bench = Bench().operate()
    bench.write(0x1400, 5, "H", 50)
    bench.write(0x6007, 0, "h", 2)
    bench.cycles(3, SHUTDOWN)
    bench.wait(0.2)
    assert bench.emergencies() == [0x8250]
    bench.cycles(3, SHUTDOWN)
    assert bench.emergencies() == [0x0000]
    bench.wait(0.2)
    assert bench.emergencies() == [0x8250]


def test_a_master_that_never_spoke_is_not_missed() -> None:
    bench = Bench().operate()
    bench.write(0x1400, 5, "H", 50)
    bench.wait(1.0)
    assert bench.emergencies() == []
