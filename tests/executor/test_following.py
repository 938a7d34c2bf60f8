"""Axes that follow streamed targets: limits at every cycle, whatever comes; silence, holds, stops, ends."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import SlotState
from mcserver.executor.shm.target_box import POINTS, Targets
from mcserver.machine.machine_file import Machine
from tests.bench.servo_streams import broken_laws_of_streams
from tests.executor.rig import CYCLE_S, Array, Rig, machine
from tests.limits import EXACTLY, assert_keeps

COUNTS_S = 0.05


class Stream:
    """Targets for the columns of slot 0's program, put as the server puts them."""

    def __init__(self, rig: Rig, columns: int) -> None:
        self.rig = rig
        self.columns = columns
        self.box = rig.executor.sink(0).targets

    def put(
        self,
        positions: list[float],
        velocities: list[float] | None = None,
        *,
        in_s: float = 0.01,
        counts_s: float = COUNTS_S,
        by_velocity: bool = False,
    ) -> None:
        """One point, to be reached in a time."""
        now = self.rig.executor.feedback.time
        knot = [now + in_s, *positions, *(velocities or [0.0] * self.columns)]
        self.box.put(Targets(np.array([knot]), now, now + counts_s, by_velocity))


def following(made: Machine | None = None, **keys: float) -> tuple[Rig, Stream]:
    """A rig whose two axes follow, energized and at rest."""
    rig = Rig(made or machine(**{"jerk": 200000.0, **keys}))  # type: ignore[arg-type]
    rig.program.capture()
    rig.program.control(ControlKind.FOLLOW, axes=3)
    rig.program.finish()
    rig.step(5)
    return rig, Stream(rig, 2)


def assert_limits(rig: Rig, velocity: float = 1.0) -> None:
    assert_keeps(rig.setpoint, (velocity, 10.0, 200.0), most=EXACTLY)


def state(rig: Rig) -> SlotState:
    return rig.executor.feedback.slots[0].state


def follow_sine(rig: Rig, stream: Stream, seconds: float) -> tuple[Array, Array]:
    """Give targets of a sine of 1 Hz and 50 mm; return what was asked for and the setpoints."""
    asked: list[float] = []
    first = len(rig.setpoints)
    for cycle in range(round(seconds / CYCLE_S)):
        angle = 2.0 * math.pi * cycle * CYCLE_S
        asked.append(0.05 * math.sin(angle))
        if cycle % 10 == 0:
            speed = 0.1 * math.pi * math.cos(angle)
            stream.put([asked[-1], 0.0], [speed, 0.0], in_s=10 * CYCLE_S)
        rig.step()
    return np.array(asked), rig.setpoint[first:, 0]


def test_a_target_moves_the_setpoint_in_the_next_cycle() -> None:
    rig, stream = following()
    stream.put([0.1, 0.0])
    rig.step()
    assert rig.setpoint[-1, 0] > 0.0


def test_a_target_far_away_is_reached_within_the_limits_and_exactly() -> None:
    rig, stream = following()
    for _ in range(100):
        stream.put([0.5, -0.2])
        rig.step(10)
    assert rig.setpoint[-1].tolist() == [0.5, -0.2]
    assert_limits(rig)
    # what a cycle of jerk moves
    assert rig.setpoint.max() <= 0.5 + 200.0 * CYCLE_S**3


def test_a_sine_with_velocities_is_followed_one_interval_behind() -> None:
    rig, stream = following()
    asked, setpoint = follow_sine(rig, stream, 2.0)
    # the first setpoint behind a target is a cycle on
    late = setpoint[1009:-1] - asked[1000:-10]
    assert np.abs(late).max() < 2e-5
    assert_limits(rig)


def test_velocities_alone_are_followed_and_a_later_position_goes_on_from_there() -> None:
    rig, stream = following()
    for _ in range(50):
        stream.put([0.0, 0.0], [0.3, -0.1], by_velocity=True)
        rig.step(10)
    moved = np.diff(rig.setpoint[-5:], axis=0) / CYCLE_S
    assert moved == pytest.approx(np.tile([0.3, -0.1], (4, 1)), abs=1e-9)
    for _ in range(50):
        stream.put([0.0, 0.0])
        rig.step(10)
    assert rig.setpoint[-1] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert_limits(rig)


def test_targets_beyond_travel_end_on_it() -> None:
    rig, stream = following(travel=100.0)
    for _ in range(100):
        stream.put([1e300, -1e300], [1e300, 5.0])
        rig.step(10)
    assert rig.setpoint[:, 0].max() <= 0.1
    assert rig.setpoint[-1, 0] == pytest.approx(0.1, abs=1e-9)
    assert_limits(rig)


def test_velocities_towards_the_end_of_travel_stop_on_it() -> None:
    rig, stream = following(travel=100.0)
    for _ in range(100):
        stream.put([0.0, 0.0], [1.0, -1.0], by_velocity=True)
        rig.step(10)
    assert np.abs(rig.setpoint).max() <= 0.1
    assert np.abs(rig.setpoint[-1]) == pytest.approx([0.1, 0.1], abs=1e-5)
    assert_limits(rig)


def test_what_is_no_number_stops_the_axes() -> None:
    rig, stream = following()
    stream.put([0.5, 0.5])
    rig.step(100)
    for _ in range(30):
        stream.put([math.nan, 0.5], [math.nan, math.inf])
        rig.step(10)
    assert np.ptp(rig.setpoint[-5:], axis=0).tolist() == [0.0, 0.0]
    assert_limits(rig)


def test_silence_stops_on_the_limits_and_ends_the_program_without_a_latch() -> None:
    rig, stream = following()
    stream.put([0.5, 0.5])
    rig.run_until(EventKind.STOPPED)
    (fault,) = rig.of(EventKind.FAULT)
    assert fault.code == FaultCode.TARGETS_LOST
    assert fault.values == pytest.approx((COUNTS_S, COUNTS_S), abs=1.5 * CYCLE_S)
    assert state(rig) is SlotState.STOPPED
    assert_limits(rig)
    stream.put([0.0, 0.0])
    stands = rig.setpoint[-1].tolist()
    rig.step(100)
    assert rig.setpoint[-1].tolist() == stands


def test_before_the_first_targets_axes_stand_and_nothing_is_silence() -> None:
    rig, _ = following()
    rig.step(1000)
    assert state(rig) is SlotState.RUNNING
    assert not rig.setpoint.any()


def test_a_hold_stops_and_a_resume_goes_on_to_the_targets() -> None:
    rig, stream = following()
    for cycle in range(150):
        if cycle == 30:
            rig.executor.mailbox.set_hold(True, 0)
        if cycle == 60:
            assert state(rig) is SlotState.HELD
            assert np.ptp(rig.setpoint[-5:], axis=0).tolist() == [0.0, 0.0]
            rig.executor.mailbox.resume(0)
        stream.put([0.5, 0.0])
        rig.step(10)
    assert rig.setpoint[-1].tolist() == [0.5, 0.0]
    assert_limits(rig)


def test_a_slot_that_still_brakes_for_a_hold_is_not_held_yet() -> None:
    rig, stream = following()
    for _ in range(20):
        stream.put([0.5, 0.0])
        rig.step(10)
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(3)
    assert state(rig) is SlotState.RUNNING


def test_an_override_bounds_the_speed() -> None:
    rig, stream = following()
    rig.executor.mailbox.set_override(0.25, 0)
    for _ in range(60):
        stream.put([0.5, 0.0])
        rig.step(10)
    assert_limits(rig, velocity=0.25)


@pytest.mark.parametrize("order", ["abort", "stop", "estop"])
def test_whoever_stops_it_brings_the_axes_to_rest(order: str) -> None:
    rig, stream = following()
    for _ in range(20):
        stream.put([0.5, -0.5])
        rig.step(10)
    mailbox = rig.executor.mailbox
    {"abort": lambda: mailbox.abort(0), "stop": mailbox.stop, "estop": mailbox.emergency_stop}[order]()
    for _ in range(40):
        stream.put([0.5, -0.5])
        rig.step(10)
    assert state(rig) is (SlotState.FAULTED if order == "estop" else SlotState.STOPPED)
    assert np.ptp(rig.setpoint[-5:], axis=0).tolist() == [0.0, 0.0]
    if order != "estop":
        assert_limits(rig)


def test_an_axis_that_fails_stops_the_others() -> None:
    rig, stream = following(drive="simulated")  # type: ignore[arg-type]
    for _ in range(20):
        stream.put([0.5, 0.5])
        rig.step(10)
    rig.executor.buses[0].trip(1)  # type: ignore[attr-defined]
    for _ in range(40):
        stream.put([0.5, 0.5])
        rig.step(10)
    assert state(rig) is SlotState.FAULTED
    assert np.ptp(rig.setpoint[-5:, 0]) == 0.0


def test_closed_it_goes_on_to_the_last_targets_and_finishes() -> None:
    rig, stream = following()
    stream.put([0.05, 0.0], counts_s=5.0)
    stream.box.close()
    rig.run_until(EventKind.FINISHED)
    assert rig.setpoint[-1].tolist() == [0.05, 0.0]
    assert_limits(rig)


def test_closed_while_targets_go_on_at_a_speed_it_ends_where_they_stop_counting() -> None:
    rig, stream = following()
    stream.put([0.0, 0.0], [0.2, 0.0], by_velocity=True)
    stream.box.close()
    rig.run_until(EventKind.FINISHED)
    assert not rig.of(EventKind.FAULT)
    assert np.ptp(rig.setpoint[-2:, 0]) < 1e-9
    assert_limits(rig)


def test_closed_before_any_targets_it_finishes_at_once() -> None:
    rig, stream = following()
    stream.box.close()
    rig.run_until(EventKind.FINISHED, limit=3)


def test_a_chunk_is_played_at_its_times_and_the_next_one_takes_over_anywhere() -> None:
    rig, stream = following()
    now = rig.executor.feedback.time
    times = np.arange(1, 101) * 0.01
    angle = 2.0 * math.pi * times
    chunk = np.stack(
        [now + times, 0.05 * np.sin(angle), 0 * times, 0.1 * math.pi * np.cos(angle), 0 * times], 1
    )
    stream.box.put(Targets(chunk, now, now + 1.0))
    first = len(rig.setpoints)
    rig.step(500)
    # the same curve again, from its middle on
    stream.box.put(Targets(chunk[40:], now + 0.5, now + 1.0))
    rig.step(490)
    asked = 0.05 * np.sin(2.0 * math.pi * np.arange(1, 991) * CYCLE_S)
    assert np.abs(rig.setpoint[first + 300 :, 0] - asked[300:]).max() < 2e-5
    assert_limits(rig)


@pytest.mark.parametrize("seed", [0, 5, 15, 31, 171])
def test_a_hostile_stream_keeps_every_limit(seed: int) -> None:
    assert broken_laws_of_streams(seed)[0] == []


def test_the_greatest_chunk_fits_and_a_garbled_box_moves_nothing() -> None:
    rig, stream = following()
    now = rig.executor.feedback.time
    knots = np.zeros((POINTS, 5))
    knots[:, 0] = now + np.arange(1, POINTS + 1) * 0.001
    stream.box.put(Targets(knots, now, now + 1.0))
    rig.step(POINTS + 10)
    stream.box._places[:, 0] = 1e9
    stream.box._counters[0] += 1
    rig.step(100)
    assert not rig.setpoint.any()


def test_missed_cycles_delay_motion_and_never_make_it_jump() -> None:
    rig, stream = following()
    for turn in range(60):
        stream.put([0.5, 0.1])
        rig.step(7)
        if turn % 9 == 5:
            rig.executor.miss(11)
    assert_limits(rig)


def test_a_stall_ends_it_where_the_axes_stand() -> None:
    rig, stream = following()
    for _ in range(20):
        stream.put([0.5, 0.5])
        rig.step(10)
    before = rig.setpoint[-1].tolist()
    rig.executor.miss(100)
    stream.put([0.5, 0.5])
    rig.step(50)
    assert state(rig) is SlotState.FAULTED
    assert FaultCode.CYCLE_STALLED in {fault.code for fault in rig.of(EventKind.FAULT)}
    assert rig.setpoint[-1].tolist() == before


def test_an_axis_energized_outside_its_travel_may_come_back_and_goes_no_further() -> None:
    wide = machine(jerk=200000.0, drive_keys="initial_position = 150.0")
    axes = tuple(msgspec.structs.replace(axis, max_position=0.1) for axis in wide.axes)
    rig, stream = following(msgspec.structs.replace(wide, axes=axes))
    for _ in range(60):
        stream.put([0.3, 0.3])
        rig.step(10)
    for _ in range(60):
        stream.put([0.0, 0.0])
        rig.step(10)
    assert rig.setpoint[-1] == pytest.approx([0.0, 0.0])
    assert rig.setpoint.max() <= 0.15 + 1e-12


def test_closed_far_from_the_last_targets_it_ends_on_them_and_not_where_they_stop_counting() -> None:
    rig, stream = following()
    stream.put([0.5, 0.0])
    stream.box.close()
    rig.run_until(EventKind.FINISHED)
    assert rig.setpoint[-1].tolist() == [0.5, 0.0]
    assert_limits(rig)


def test_closed_in_a_hold_it_ends_once_a_resume_has_let_it_arrive() -> None:
    rig, stream = following()
    stream.put([0.5, 0.0])
    rig.step(20)
    rig.executor.mailbox.set_hold(True, 0)
    stream.box.close()
    rig.step(500)
    assert state(rig) is SlotState.HELD
    rig.executor.mailbox.resume(0)
    rig.run_until(EventKind.FINISHED)
    assert rig.setpoint[-1].tolist() == [0.5, 0.0]
