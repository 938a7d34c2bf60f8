"""A bus of CiA 402 drives: capture, modes, what is sent when, and how it begins and ends."""

from __future__ import annotations

import random
import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from mcserver.can.cob import SYNC
from mcserver.can.pdo_layout import RPDO1, Mode
from mcserver.drives.bus import DriveMode, DriveState
from mcserver.drives.can_bus import CanBus
from mcserver.drives.cia402.state import STATE_BITS
from mcserver.errors import RuntimeFault
from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import AxisCondition
from mcserver.motion.canonical import AxisOperation
from tests.drives.can_rig import Bench, CanRig, energized, machine
from tests.drives.fake_can import DISABLED, ENABLED, QUICK_STOP, FakeBus

COUNT_M = 1e-6  # of the rig's axes: 10 mm a turn of 10 000 counts


# ---------------------------------------------------------------------- capture


def test_hundreds_of_random_positions_are_captured_without_a_count_of_jump() -> None:
    chance = random.Random(402)
    jumps = []
    for _ in range(100):
        positions = [chance.randint(-(2**31), 2**31 - 1) for _ in range(4)]
        bench = Bench(machine(4, cycle_hz=500.0), positions)
        bench.tell(DriveMode.POSITION)
        bench.exchange(30)
        assert [drive.word for drive in bench.drives] == [ENABLED] * 4
        assert [drive.position for drive in bench.drives] == positions
        jumps += [jump for drive in bench.drives for jump in drive.jumps]
    assert jumps == [0] * 400


def test_the_target_is_the_actual_position_before_and_while_a_drive_is_enabled() -> None:
    bench = Bench(machine(1), [4321])
    bench.tell(DriveMode.POSITION)
    for _ in range(20):
        before = len(bench.port.sent)
        bench.exchange()
        targets = [RPDO1.packing.unpack(data)[2] for cob, data in bench.port.sent[before:] if cob == 0x201]
        assert targets == [4321]


STATUSWORDS = st.one_of(st.sampled_from([0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08]), st.integers(0, 0xFFFF))
MODES = st.sampled_from([Mode.CYCLIC_POSITION, Mode.CYCLIC_POSITION, Mode.CYCLIC_VELOCITY])


@given(st.lists(st.tuples(STATUSWORDS, MODES, st.integers(-(2**31), 2**31 - 1)), min_size=8, max_size=60))
@settings(max_examples=150)
def test_whatever_a_drive_shows_it_is_enabled_only_where_it_was_read_last(
    shown: list[tuple[int, Mode, int]],
) -> None:
    bench = Bench(machine(1), [5])
    drive = bench.drives[0]
    # it obeys nothing and says what it likes
    drive.stuck = drive.jammed = True
    bench.tell(DriveMode.POSITION)
    enabled = 0
    for word, mode, position in shown:
        energized = bench.feedback.state[0] == DriveState.ENERGIZED
        read = drive.position
        drive.word, drive.shown, drive.exact = word, mode, float(position)
        before = len(bench.port.sent)
        bench.exchange()
        for cob, data in bench.port.sent[before:]:
            controlword, _, target = RPDO1.packing.unpack(data) if cob == 0x201 else (0, 0, 0)
            if controlword & 0x0F == 0x0F and not energized:
                enabled += 1
                assert target == read
    event(f"enabled: {enabled > 0}")


def controlwords(bench: Bench, before: int) -> list[int]:
    return [struct.unpack_from("<H", data)[0] for cob, data in bench.port.sent[before:] if cob == 0x201]


def edges(words: list[int]) -> int:
    """Rising edges of bit 7."""
    return sum(not before & 0x80 and bool(after & 0x80) for before, after in pairwise(words))


@given(st.lists(STATUSWORDS, max_size=30))
@settings(max_examples=100)
def test_whatever_came_before_a_reset_begins_with_bit_7_low(words: list[int]) -> None:
    bench = Bench(machine(1))
    drive = bench.drives[0]
    drive.stuck = drive.jammed = True
    bench.tell(DriveMode.RESET)
    for word in words:
        drive.word = word
        bench.exchange()
    bench.tell(DriveMode.OFF)
    bench.exchange()
    drive.word = 0x08
    before = len(bench.port.sent)
    bench.tell(DriveMode.RESET)
    bench.exchange(3)
    sent = controlwords(bench, before)
    assert (sent[0], edges(sent)) == (0, 1)


def test_a_fault_that_stays_gets_another_edge_now_and_then() -> None:
    bench = Bench(machine(1))
    bench.drives[0].stuck = True
    bench.drives[0].word = 0x08
    before = len(bench.port.sent)
    bench.tell(DriveMode.RESET)
    bench.exchange(60)
    assert edges(controlwords(bench, before)) == 3
    assert bench.feedback.state[0] == DriveState.FAULT


def test_an_answer_from_before_the_command_does_not_count() -> None:
    bench = energized()
    bench.tell(DriveMode.OFF)
    bench.exchange()
    bench.tell(DriveMode.POSITION)
    states = []
    for _ in range(20):
        bench.exchange()
        states.append(int(bench.feedback.state[0]))
    assert states[0] == DriveState.STARTING
    assert states[-1] == DriveState.ENERGIZED
    assert DriveState.OFF not in states


def test_a_coasting_axis_is_captured_where_it_will_be() -> None:
    rig = CanRig(machine(1))
    rig.drives[0].drift = lambda: 100  # 0.1 m/s
    rig.step(30)
    rig.program.capture()
    rig.program.finish()
    places = []
    for _ in range(60):
        rig.step()
        places.append(rig.drives[0].position)
    assert rig.executor.feedback.condition[0] == AxisCondition.HOLDING
    # it goes on at its speed, and comes to rest within its limits: 10 counts a cycle squared
    assert rig.drives[0].jumps == [100]
    assert np.abs(np.diff(places, 2)).max() <= 10
    assert places[-1] == places[-2]


# ---------------------------------------------------------------------- off, stop, release


def test_off_disables_the_voltage() -> None:
    bench = energized()
    bench.tell(DriveMode.OFF)
    bench.exchange(5)
    assert bench.drives[0].word == DISABLED
    assert bench.feedback.state[0] == DriveState.OFF


def test_stop_is_a_quick_stop_and_then_off() -> None:
    bench = energized()
    bench.tell(DriveMode.STOP)
    bench.exchange(2)
    assert bench.drives[0].word == QUICK_STOP
    assert bench.feedback.state[0] == DriveState.STOPPING
    bench.exchange(10)
    assert bench.drives[0].word == DISABLED
    assert bench.feedback.state[0] == DriveState.OFF


def test_release_stops_this_axis_s_rpdo_and_no_other() -> None:
    rig = CanRig(machine(2))
    rig.program.capture()
    rig.program.axis(AxisOperation.RELEASE, 0b01)
    rig.run_until(EventKind.AXIS_DONE)
    rig.step(20)
    before = len(rig.ports["can0"].sent)
    rig.step(10)
    identifiers = [cob for cob, _ in rig.ports["can0"].sent[before:]]
    assert set(identifiers) == {0x202, SYNC}
    assert identifiers.count(SYNC) == 10
    assert rig.executor.feedback.condition[0] == AxisCondition.RELEASED


def test_a_released_drive_that_times_out_latches_nothing_and_is_captured_again() -> None:
    rig = CanRig(machine(1), positions=[77])
    rig.program.capture()
    rig.program.axis(AxisOperation.RELEASE)
    rig.play()
    rig.step(20)
    rig.drives[0].word = DISABLED
    rig.drives[0].emergency(0x8250)
    rig.step(5)
    assert [event.code for event in rig.of(EventKind.FAULT)] == [FaultCode.DRIVE_MESSAGE]
    program = rig.open(0)
    program.capture()
    program.finish()
    rig.run()
    assert rig.executor.feedback.condition[0] == AxisCondition.HOLDING
    assert rig.drives[0].jumps == [0, 0]


# ---------------------------------------------------------------------- position


def test_a_rotary_axis_turns_on_past_the_wrap_of_32_bits() -> None:
    start = 2**31 - 500
    bench = energized(positions=(start,))
    for _ in range(20):
        bench.setpoints.position[:] += 100 * COUNT_M
        bench.exchange(follow=False)
    bench.exchange(3, follow=False)
    assert bench.drives[0].position % 2**32 == (start + 2000) % 2**32
    assert bench.feedback.position[0] == pytest.approx((start + 2000) * COUNT_M, abs=1e-9)
    assert bench.feedback.state[0] == DriveState.ENERGIZED


def test_an_inverted_axis_counts_the_other_way() -> None:
    bench = Bench(machine(1, drive="invert = true"), [1000])
    assert bench.feedback.position[0] == pytest.approx(-1000 * COUNT_M)
    bench.tell(DriveMode.POSITION)
    bench.exchange(20)
    bench.setpoints.position[:] += 5 * COUNT_M
    bench.exchange(3, follow=False)
    assert bench.drives[0].position == 995


def test_a_velocity_is_zero_again_after_a_reboot() -> None:
    bench = Bench(machine(1), [1_000_000])
    bench.exchange(10)
    drive = bench.drives[0]
    drive.reboot()
    bench.exchange(10)
    drive.exact = 0.0
    drive.operate()
    speeds = []
    for _ in range(10):
        bench.exchange()
        speeds.append(float(bench.feedback.velocity[0]))
    assert speeds == [0.0] * 10
    assert bench.feedback.position[0] == 0.0


# ---------------------------------------------------------------------- beginning and end


def test_a_bus_that_boots_sends_sync_alone_until_every_drive_has_answered() -> None:
    bench = Bench(machine(2))
    assert {cob for cob, _ in bench.port.sent} == {SYNC}


def test_a_drive_that_does_not_answer_is_named_and_the_port_closed() -> None:
    described = machine(2)
    port = FakeBus()
    bus = CanBus(described, described.buses[0], [0, 1], opener=lambda _a: port, wait=lambda _s: None)
    with pytest.raises(RuntimeFault) as refused:
        bus.boot()
    assert refused.value.code == "MC411"
    assert "axis 0 (node 1 on can0)" in refused.value.message
    assert port.closed


def test_a_bus_that_is_closed_leaves_its_drives_off() -> None:
    bench = energized()
    bench.bus.close()
    assert bench.drives[0].word == DISABLED
    assert bench.port.closed


@pytest.mark.parametrize("junk", [b"", b"\x01", bytes(8)])
def test_malformed_frames_change_nothing(junk: bytes) -> None:
    bench = energized()
    for cob in (0x081, 0x181, 0x281, 0x701, 0x7FF, 0x000):
        bench.port.waiting.append((cob, junk if cob != 0x701 else junk + b"\x05\x05"))
    bench.exchange(3)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    assert STATE_BITS == 0x6F
