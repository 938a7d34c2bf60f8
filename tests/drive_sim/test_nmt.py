"""NMT states, boot-up, heartbeats and emergency messages of the simulated drive."""

from __future__ import annotations

import struct

import pytest

from mcserver.can.cob import SYNC, Function, NmtCommand, NmtState
from tests.drive_sim.bench import (
    ENABLE,
    ENABLED,
    FAULT,
    FAULT_RESET,
    NODE,
    QUICK_STOPPED,
    SWITCH_ON_DISABLED,
    Aborted,
    Bench,
)

HEARTBEAT = Function.HEARTBEAT + NODE
MASTER = 127


@pytest.fixture
def bench() -> Bench:
    return Bench().boot()


def state_of(bench: Bench) -> NmtState:
    """As the heartbeat shows it."""
    bench.taken(HEARTBEAT)
    bench.wait(0.1)
    return NmtState(bench.taken(HEARTBEAT)[-1][0])


def test_a_node_boots_and_is_pre_operational() -> None:
    bench = Bench()
    bench.node.switch_on(bench.now)
    bench.wait(0.01)
    assert bench.sent == []
    bench.wait(0.1)
    assert bench.sent == [(HEARTBEAT, b"\x00")]
    bench.write(0x1017, 0, "H", 10)
    assert state_of(bench) is NmtState.PRE_OPERATIONAL


@pytest.mark.parametrize("addressed", [NODE, 0])
def test_nmt_commands_change_the_state(bench: Bench, addressed: int) -> None:
    bench.write(0x1017, 0, "H", 10)
    for command, state in (
        (NmtCommand.START, NmtState.OPERATIONAL),
        (NmtCommand.STOP, NmtState.STOPPED),
        (NmtCommand.ENTER_PRE_OPERATIONAL, NmtState.PRE_OPERATIONAL),
    ):
        bench.nmt(command, addressed)
        assert state_of(bench) is state


def test_commands_for_other_nodes_and_malformed_ones_change_nothing(bench: Bench) -> None:
    bench.write(0x1017, 0, "H", 10)
    bench.nmt(NmtCommand.START, NODE + 1)
    for message in (b"", b"\x01", b"\x01\x05\x00", b"\x33\x05"):
        bench.receive(0, message)
    assert state_of(bench) is NmtState.PRE_OPERATIONAL


def test_heartbeats_come_in_their_time_from_the_moment_it_is_written(bench: Bench) -> None:
    bench.write(0x1017, 0, "H", 50)
    assert len(bench.taken(HEARTBEAT)) == 1
    bench.wait(1.0)
    assert len(bench.taken(HEARTBEAT)) == 20
    bench.write(0x1017, 0, "H", 0)
    bench.wait(1.0)
    assert bench.taken(HEARTBEAT) == []


@pytest.mark.parametrize("whole", [True, False])
def test_a_reset_brings_the_boot_up_message_and_the_defaults(bench: Bench, whole: bool) -> None:
    bench.write(0x1017, 0, "H", 50)
    bench.write(0x6065, 0, "I", 77)
    bench.taken()
    bench.nmt(NmtCommand.RESET_NODE if whole else NmtCommand.RESET_COMMUNICATION)
    bench.wait(0.2)
    assert bench.sent == [(HEARTBEAT, b"\x00")]
    assert bench.read(0x1017, 0, "H") == 0
    assert bench.read(0x6065, 0, "I") == (0xFFFFFFFF if whole else 77)


def test_a_booting_node_is_silent(bench: Bench) -> None:
    bench.nmt(NmtCommand.RESET_NODE)
    bench.taken()
    bench.receive(Function.SDO_REQUEST + NODE, struct.pack("<BHB4x", 0x40, 0x1000, 0))
    bench.receive(SYNC)
    assert bench.sent == []


def test_pdos_are_sent_in_operational_alone() -> None:
    bench = Bench().operate()
    bench.receive(SYNC)
    assert len(bench.taken(Function.TPDO1 + NODE)) == 1
    bench.nmt(NmtCommand.ENTER_PRE_OPERATIONAL)
    bench.receive(SYNC)
    assert bench.taken(Function.TPDO1 + NODE) == []


def test_a_lost_master_stops_the_drive_by_1016h_and_6007h() -> None:
    bench = Bench().operate()
    bench.write(0x1016, 1, "I", MASTER << 16 | 200)
    bench.write(0x6007, 0, "h", 3)
    bench.receive(Function.HEARTBEAT + MASTER, b"\x05")
    bench.enable()
    for _ in range(30):
        bench.receive(Function.HEARTBEAT + MASTER, b"\x05")
        bench.cycles(10, ENABLE)
    assert bench.state == ENABLED
    assert bench.emergencies() == []
    bench.wait(0.25)
    assert bench.emergencies() == [0x8130]
    assert bench.state in (QUICK_STOPPED, SWITCH_ON_DISABLED)
    assert not bench.node.nmt.operational
    bench.receive(Function.HEARTBEAT + MASTER, b"\x05")
    assert bench.emergencies() == [0x0000]


def test_a_master_that_was_never_heard_is_not_missed() -> None:
    bench = Bench().operate()
    bench.write(0x1016, 1, "I", MASTER << 16 | 50)
    bench.wait(1.0)
    assert bench.emergencies() == []
    assert bench.node.nmt.operational


@pytest.mark.parametrize(("option", "state"), [(0, ENABLED), (1, FAULT), (2, SWITCH_ON_DISABLED)])
def test_leaving_operational_acts_by_6007h(option: int, state: int) -> None:
    bench = Bench().operate()
    bench.write(0x6007, 0, "h", option)
    bench.enable()
    bench.nmt(NmtCommand.ENTER_PRE_OPERATIONAL)
    bench.wait(0.5)
    assert bench.state == state


def test_an_emergency_is_sent_registered_and_remembered() -> None:
    bench = Bench().operate().enable()
    bench.node.request("emcy", {"code": 0x4310}, bench.now)
    (payload,) = bench.taken(Function.EMCY + NODE)
    assert payload == struct.pack("<HB5x", 0x4310, 0x09)
    assert bench.read(0x1001, 0, "B") == 0x09
    assert bench.read(0x603F, 0, "H") == 0x4310
    assert (bench.read(0x1003, 0, "B"), bench.read(0x1003, 1, "I")) == (1, 0x4310)


def test_the_end_of_all_errors_is_sent_and_the_history_stays_until_0_is_written() -> None:
    bench = Bench().operate().enable()
    for code in (0x3210, 0x4310):
        bench.node.request("emcy", {"code": code}, bench.now)
    bench.cycles(60)
    bench.cycles(2, FAULT_RESET)
    assert bench.emergencies() == [0x3210, 0x4310, 0x0000]
    assert bench.read(0x1001, 0, "B") == 0
    assert [bench.read(0x1003, subindex, "I") for subindex in (1, 2)] == [0x4310, 0x3210]
    with pytest.raises(Aborted):
        bench.write(0x1003, 0, "B", 1)
    bench.write(0x1003, 0, "B", 0)
    assert [bench.read(0x1003, subindex, "I") for subindex in (1, 2)] == [0, 0]
