"""The port of the cycle on a master in memory: working counters, lost frames, states, released axes."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from mcserver.can.cob import SYNC, Function, NmtState
from mcserver.canopen.coe import configure_coe
from mcserver.canopen.settings import settings_of
from mcserver.ethercat.port import EthercatPort
from mcserver.ethercat.slave import AlState, EthercatSlave, MailboxSdo
from mcserver.machine.machine_file import parse_machine
from tests.ethercat.rig import line_of

COUNT = 3
PERIOD_NS = 10_000_000


@dataclass
class Device:
    """A slave of pysoem, as far as the cycle goes."""

    input: bytes
    output: bytes = b""

    def add_emergency_callback(self, callback: object) -> None:
        del callback


@dataclass
class Master:
    """pysoem's master: each frame comes back with a working counter."""

    counters: list[int] = field(default_factory=list)
    sends: bool = True
    dc_time: int = 0

    def send_processdata(self) -> int:
        return int(self.sends)

    def receive_processdata(self, timeout_us: int) -> int:
        assert timeout_us <= 200
        return self.counters.pop(0) if self.counters else 3 * COUNT


class Line:
    """A port and what is behind it."""

    def __init__(self) -> None:
        machine = parse_machine(line_of(COUNT))
        self.master = Master()
        self.devices = [Device(bytes(9)) for _ in range(COUNT)]
        slaves = []
        for device, drive in zip(self.devices, settings_of(machine), strict=True):
            writes, planned = configure_coe(drive, machine.cycle_s)
            sdo = MailboxSdo(None, device, drive)
            slave = EthercatSlave(drive, device, sdo, planned.process_data, writes)
            slaves.append(slave)
        self.troubles = 0
        self.closed = 0
        self.port = EthercatPort(
            self.master,
            slaves,
            silence_cycles=3,
            patience_cycles=2,
            on_close=self._close,
            period_ns=PERIOD_NS,
        )
        self.port.states = (AlState.OP,) * COUNT
        self.port.drain()
        self.port.troubled = self._trouble
        self.sync = self.port.prepare(SYNC, 0)

    def cycle(self) -> list[tuple[int, bytes]]:
        assert self.port.send_prepared(self.sync)
        return self.port.drain()

    def _trouble(self) -> None:
        self.troubles += 1

    def _close(self) -> None:
        self.closed += 1


def test_answers_of_all_slaves_come_with_their_frame() -> None:
    line = Line()
    assert [identifier for identifier, _ in line.cycle()] == [0x181, 0x182, 0x183]
    assert line.port.drain() == []


@pytest.mark.parametrize("counted", [6, 8, 10, 12])
def test_another_working_counter_is_an_answer_of_nobody(counted: int) -> None:
    line = Line()
    line.master.counters = [counted]
    assert line.cycle() == []
    assert (line.troubles, line.port.counters.malformed, line.port.counters.down) == (1, 1, False)


def test_frames_that_stay_out_are_a_bus_that_is_away_until_one_comes_back() -> None:
    line = Line()
    line.master.counters = [-1, -1, -1]
    assert [line.cycle() or line.port.counters.down for _ in range(3)] == [False, False, True]
    assert len(line.cycle()) == COUNT
    assert not line.port.counters.down


def test_slaves_that_are_known_to_be_gone_are_not_waited_for() -> None:
    line = Line()
    line.port.states = (AlState.OP, AlState.NONE, AlState.OP)
    line.master.counters = [6]
    assert [identifier for identifier, _ in line.cycle()] == [0x181, 0x183]


@pytest.mark.parametrize("counted", [9, 7])
def test_a_slave_in_safeop_may_take_outputs_or_not(counted: int) -> None:
    line = Line()
    line.port.states = (AlState.OP, AlState.SAFEOP, AlState.OP)
    line.master.counters = [counted]
    frames = dict(line.cycle())
    assert frames.keys() == {0x181, 0x182, 0x183, Function.HEARTBEAT + 2}
    assert frames[Function.HEARTBEAT + 2] == bytes((NmtState.PRE_OPERATIONAL,))


def test_a_slave_in_init_has_been_switched_off() -> None:
    line = Line()
    line.port.states = (AlState.OP, AlState.OP, AlState.INIT)
    line.master.counters = [6]
    assert (Function.HEARTBEAT + 3, bytes((NmtState.BOOT_UP,))) in line.cycle()


def test_an_error_code_is_told_once_and_its_end_too() -> None:
    line = Line()
    at = 7
    line.devices[1].input = bytes(at) + b"\x10\x23"
    told = [payload for identifier, payload in line.cycle() if identifier == Function.EMCY + 2]
    assert told == [b"\x10\x23\x01" + bytes(5)]
    assert len(line.cycle()) == COUNT
    line.devices[1].input = bytes(9)
    assert (Function.EMCY + 2, bytes(8)) in line.cycle()


def test_outputs_that_are_not_sent_any_more_become_zero() -> None:
    line = Line()
    buffer = line.port.prepare(Function.RPDO1 + 1, 11)
    buffer[line.port.payload_offset :] = b"\x0f" * 11
    assert not line.port.begun
    line.port.send_prepared(buffer)
    assert line.port.begun
    seen = []
    for _ in range(4):
        line.cycle()
        seen.append(line.devices[0].output == bytes(11))
    assert seen == [False, False, True, True]


def test_closing_twice_closes_once() -> None:
    line = Line()
    line.port.close()
    line.port.close()
    assert line.closed == 1


@pytest.mark.parametrize(("passed_at", "error"), [(0, 0), (1000, 1000), (PERIOD_NS - 1000, -1000)])
def test_the_clock_of_the_bus_says_how_late_its_frame_passed(passed_at: int, error: int) -> None:
    line = Line()
    assert line.port.clock_error_ns is None
    line.port.clocked = True
    line.master.dc_time = 7 * PERIOD_NS + passed_at
    line.cycle()
    assert line.port.clock_error_ns == error
