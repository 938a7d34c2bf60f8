"""Feed hold, overrides, starvation and single lines: always on the path, always within limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.shm.feedback import SlotState
from mcserver.executor.stopping import StopTimes, longest_stop, stopping_rows
from tests.executor.rig import CYCLE_S, Array, Program, Rig, give, machine, s_curve
from tests.limits import assert_keeps

ACCELERATION = 10.0


def line(length: float, speed: float, direction: tuple[float, float] = (1.0, 0.0)) -> tuple[Array, Array]:
    """Rows of a line from rest to rest, without a jerk limit."""
    position, velocity = s_curve(length, speed)
    return np.outer(position, direction), np.outer(velocity, direction)


def assert_ends_at(rig: Rig, length: float) -> None:
    rig.run()
    assert rig.setpoint[-1, 0] == pytest.approx(length, abs=1e-12)
    assert_keeps(rig.setpoint, (None, ACCELERATION))
    assert np.all(np.diff(rig.setpoint[:, 0]) >= -1e-15)


def started() -> Rig:
    """All of a line of 0.8 m."""
    rig = Rig(machine())
    points, slopes = line(0.8, 0.8)
    rig.program.start_line(1)
    rig.program.first_rows(points, slopes)
    rig.program.last_rows(points[:0], slopes[:0])
    return rig


def test_a_held_program_stays_until_it_is_resumed_and_then_ends_at_its_target() -> None:
    rig = started()
    rig.step(300)
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(500)
    held = rig.setpoint[-1]
    rig.step(500)
    assert np.array_equal(rig.setpoint[-1], held)
    rig.executor.mailbox.resume(0)
    rig.run()
    assert rig.setpoint[-1, 0] == pytest.approx(0.8, abs=1e-12)


def test_rows_are_never_played_faster_than_they_are_planned() -> None:
    rig = started()
    rig.executor.mailbox.set_override(2.0, 0)
    plain = started()
    assert rig.run() == plain.run()
    assert np.array_equal(rig.setpoint, plain.setpoint)


@pytest.mark.parametrize(("override", "rate"), [(2.0, 1.0), (1.5, 1.0), (1.0, 2.0 / 3.0), (0.5, 1.0 / 3.0)])
def test_rows_that_are_planned_for_more_are_played_at_their_share_of_it(override: float, rate: float) -> None:
    rig = Rig(machine())
    program = rig.program
    program.capture()
    program.control(ControlKind.BEGIN, axes=3)
    program.rows(*line(0.8, 0.6), 3, feed_scale=1.5)
    program.control(ControlKind.END, axes=3)
    program.finish()
    rig.step(200)
    rig.executor.mailbox.set_override(override, 0)
    rig.step(200)
    assert rig.executor.feedback.slots[0].rate == pytest.approx(rate, rel=1e-9)
    assert_ends_at(rig, 0.8)


def test_the_machines_override_and_the_slots_multiply() -> None:
    rig = started()
    rig.executor.mailbox.set_override(0.5, 0)
    rig.executor.mailbox.set_override(0.5)
    rig.step(2000)
    velocity = np.diff(rig.setpoint[:, 0]) / CYCLE_S
    assert velocity.max() == pytest.approx(0.2, rel=1e-6)


def test_a_ring_that_runs_dry_holds_on_the_path_and_goes_on_by_itself() -> None:
    rig = Rig(machine())
    points, slopes = line(0.8, 0.8)
    rig.program.start_line(1)
    rig.program.first_rows(points[:400], slopes[:400])
    rig.step(1500)
    assert len(rig.of(EventKind.STARVED)) == 1
    assert rig.executor.feedback.slots[0].state is SlotState.STARVED
    assert rig.setpoint[-1, 0] <= points[399, 0]
    rig.program.last_rows(points[400:], slopes[400:])
    assert_ends_at(rig, 0.8)
    assert len(rig.of(EventKind.STARVED)) == 1


@pytest.mark.parametrize("left", [5, 14])
def test_a_motion_that_stands_before_its_last_rows_says_so_again_of_what_comes_there(left: int) -> None:
    rig = Rig(machine())
    points, slopes = line(0.8, 0.05)
    rig.program.start_line(1)
    rig.program.first_rows(points[:400], slopes[:400])
    # so slow that a hold stands where it is ordered
    rig.executor.mailbox.set_override(0.001, 0)
    rig.step(400)
    rig.executor.mailbox.set_override(1.0, 0)
    slot = rig.executor.executor._slots[0]
    while slot.playback.last_u - slot.u > left:
        rig.step()
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(400)
    rig.executor.mailbox.resume(0)
    rig.step(1500)
    starved = len(rig.of(EventKind.STARVED))
    assert starved == 1
    rig.program.control(ControlKind.SETTLE, token=7)
    rig.step(1500)
    assert rig.executor.feedback.slots[0].u < 400.0
    assert not rig.of(EventKind.SETTLED)
    assert len(rig.of(EventKind.STARVED)) == starved + 1


# a change back to 100 % that ended right before the last row, with no room left for the stop
@example(bites=[(47, 22), (74, 111)])
# no stop at full rate ended on the last known row, before which the rows brake with all of the acceleration
@example(
    bites=[
        (125, 148),
        (32, 76),
        (59, 86),
        (139, 100),
        (188, 26),
        (42, 152),
        (68, 138),
        (111, 133),
        (127, 109),
        (141, 184),
    ]
)
@settings(max_examples=12)
@example(bites=[(22, 133), (139, 67), (50, 102), (3, 140), (72, 91), (67, 139)])
@example(bites=[(47, 24), (142, 66), (9, 173), (19, 22), (5, 116), (4, 194), (194, 72), (64, 69), (29, 160)])
@example(bites=[(1062, 1062), (1, 20)])
@given(bites=st.lists(st.tuples(st.integers(1, 200), st.integers(1, 800)), min_size=1, max_size=12))
def test_rows_that_trickle_in_never_break_the_acceleration_limit(bites: list[tuple[int, int]]) -> None:
    rig = Rig(machine())
    points, slopes = line(0.8, 0.8, (1.0, 0.5))
    done, cycles = bites[0]
    rig.program.first_rows(points[:done], slopes[:done])
    rig.step(cycles)
    for rows, cycles in bites[1:]:
        part = slice(done, min(done + rows, len(points)))
        if part.start < part.stop:
            rig.program.rows(points[part], slopes[part], 3)
            done = part.stop
        rig.step(cycles)
    rig.program.last_rows(points[done:], slopes[done:])
    assert_ends_at(rig, 0.8)


@pytest.mark.parametrize("strength", [1.2e-4, 2e-4])
@pytest.mark.parametrize("order", ["hold", "starve"])
def test_motion_whose_own_vertices_pass_the_jerk_limit_goes_on_after_it_stood(
    order: str, strength: float
) -> None:
    # an exact path of many short lines: each change of the rate passes the limit somewhere, as the rows do
    rig = Rig(machine(jerk=200_000.0))
    position, velocity = s_curve(0.4, 0.4, 0.5 * ACCELERATION)
    noise = np.where(np.arange(len(position)) % 2, strength, -strength)
    noise[:60] = noise[-60:] = 0.0
    points = np.stack([position, np.cumsum(noise) * CYCLE_S], 1)
    slopes = np.stack([velocity, noise], 1)
    known = 300 if order == "starve" else len(points)
    rig.program.first_rows(points[:known], slopes[:known])
    rig.step(200)
    if order == "hold":
        give(rig, "hold")
        rig.step(1500)
        rig.executor.mailbox.set_hold(False, 0)
    else:
        rig.step(1500)
        assert rig.executor.feedback.slots[0].rate == 0.0
    rig.program.last_rows(points[known:], slopes[known:])
    rig.run_until(EventKind.FINISHED)
    assert rig.setpoint[-1, 0] == pytest.approx(0.4, abs=1e-9)
    assert_keeps(rig.setpoint[:, 0], (None, ACCELERATION))


def test_enough_rows_ahead_are_played_without_slowing_down() -> None:
    rig = Rig(machine())
    points, slopes = line(0.8, 0.8)
    ahead = stopping_rows(longest_stop(rig.machine))
    rig.program.first_rows(points[:ahead], slopes[:ahead])
    for row in range(ahead, len(points)):
        rig.program.rows(points[row : row + 1], slopes[row : row + 1], 3)
        rig.step()
        assert rig.executor.feedback.slots[0].rate == 1.0


def test_slow_rows_need_fewer_of_them_ahead() -> None:
    rig = Rig(machine(jerk=100_000.0))
    position, velocity = s_curve(0.05, 0.05, ACCELERATION / 3)
    points, slopes = np.outer(position, [1.0, 0.0]), np.outer(velocity, [1.0, 0.0])
    stop_s = float(StopTimes(rig.machine).of(slopes).max())
    ahead = stopping_rows(stop_s)
    assert ahead < 0.9 * stopping_rows(longest_stop(rig.machine))
    rig.program.first_rows(points[:ahead], slopes[:ahead])
    for row in range(ahead, len(points)):
        assert rig.program.ring.stop_ahead() <= stop_s + 1e-9
        rig.program.rows(points[row : row + 1], slopes[row : row + 1], 3)
        rig.step()
        assert rig.executor.feedback.slots[0].rate == 1.0


def at_a_pause() -> Rig:
    """A program that stands at a pause in its line 5."""
    rig = Rig(machine())
    rig.program.start_line(5)
    rig.program.control(ControlKind.PAUSE)
    rig.program.end_line()
    rig.program.finish()
    rig.run_until(EventKind.PAUSED)
    return rig


def test_a_pause_waits_for_resume() -> None:
    rig = at_a_pause()
    rig.step(100)
    assert not rig.of(EventKind.LINE_END)
    rig.executor.mailbox.end_pause(0)
    rig.run()
    assert rig.of(EventKind.FINISHED)


def test_the_end_of_a_hold_ends_no_pause() -> None:
    rig = at_a_pause()
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(20)
    rig.executor.mailbox.resume(0)
    rig.step(100)
    assert not rig.of(EventKind.LINE_END)
    rig.executor.mailbox.end_pause(0)
    rig.run()
    assert rig.of(EventKind.FINISHED)


def test_an_axis_that_was_lent_at_a_pause_never_has_two_owners() -> None:
    rig = at_a_pause()
    (paused,) = rig.of(EventKind.PAUSED)
    assert paused.token == 0b11
    other = rig.open(1, 0b01)
    other.start_line(1)
    other.dwell(10.0)
    rig.step(20)
    assert rig.executor.feedback.slots[1].state is SlotState.RUNNING
    # the confirmation comes all the same: the one that it concerns ends, not the one that has the axis
    rig.executor.mailbox.end_pause(0)
    rig.step(20)
    assert [(event.code, event.program) for event in rig.of(EventKind.FAULT)] == [(408, 0)]
    assert rig.executor.feedback.slots[0].state is SlotState.FAULTED
    assert rig.executor.feedback.slots[1].state is SlotState.RUNNING


def test_a_dwell_does_not_pass_in_feed_hold() -> None:
    rig = Rig(machine())
    rig.program.start_line(1)
    rig.program.dwell(0.1)
    rig.program.end_line()
    rig.program.finish()
    rig.step(50)
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(200)
    rig.executor.mailbox.resume(0)
    rig.run()
    assert rig.time_of(EventKind.LINE_END, 1) == pytest.approx(0.3, abs=2e-3)


def test_a_program_may_be_opened_held_and_begins_with_resume() -> None:
    rig = Rig(machine())
    rig.play()
    program = Program(rig.executor.open_slot(1, 3, hold=True), 2)
    program.capture()
    program.start_line(1)
    program.move({0: 0.1}, 100)
    program.end_line()
    rig.step(100)
    assert not rig.of(EventKind.LINE_START)
    rig.executor.mailbox.resume(1)
    rig.run_until(EventKind.LINE_END)
