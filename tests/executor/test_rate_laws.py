"""Feed hold, resume and overrides under any orders: velocity, acceleration and jerk of every axis at every
cycle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.executor.entries import EventKind
from mcserver.executor.shm.feedback import AxisCondition, SlotState
from tests.executor.rig import CYCLE_S, Array, Rig, give, machine, s_curve
from tests.limits import assert_keeps

VELOCITY, ACCELERATION, JERK = 1.0, 10.0, 300.0
RADIUS = 0.05
ORDERS = ("hold", "resume", 0.0, 0.3, 0.5, 0.77, 0.97, 1.0, 1.4, 2.0)


@dataclass(frozen=True)
class Rows:
    """Positions and velocities of two axes at whole cycles, shape (n, 2)."""

    position: Array
    velocity: Array


def line(speed: float, jerk: float | None) -> Rows:
    position, velocity = s_curve(min(0.6, 3.0 * speed), speed, ACCELERATION, jerk)
    direction = np.array([1.0, 0.3])
    return Rows(np.outer(position, direction), np.outer(velocity, direction))


def circle(speed: float, jerk: float | None) -> Rows:
    """About (`RADIUS`, 0), a third of the acceleration along the path."""
    if jerk is not None:
        speed = min(speed, (0.5 * jerk * RADIUS**2) ** (1.0 / 3.0))
        jerk *= 0.25
    length = 2.0 * np.pi * RADIUS * (1.0 + 2.0 * speed)
    position, velocity = s_curve(length, min(speed, 0.5), ACCELERATION / 3.0, jerk)
    angle = position / RADIUS
    points = RADIUS * np.stack([1.0 - np.cos(angle), np.sin(angle)], axis=1)
    return Rows(points, velocity[:, None] * np.stack([np.sin(angle), np.cos(angle)], axis=1))


def away_from(path: str, points: Array) -> float:
    """Greatest distance of setpoints from the path [m]."""
    if path == "circle":
        return float(np.abs(np.hypot(points[:, 0] - RADIUS, points[:, 1]) - RADIUS).max())
    return float(np.abs(points[:, 1] - 0.3 * points[:, 0]).max())


def start(path: str, speed: float, jerk: float | None, known: int | None = None) -> tuple[Rig, Rows]:
    """A motion of which some rows are known, all of them where no number says otherwise."""
    rig = Rig(machine(jerk=None if jerk is None else 1000.0 * jerk))
    rows = line(speed, jerk) if path == "line" else circle(speed, jerk)
    rig.program.start_line(1)
    rig.program.first_rows(rows.position[:known], rows.velocity[:known])
    if known is None:
        rig.program.last_rows(rows.position[:0], rows.velocity[:0])
    return rig, rows


def run_with_the_rest(rig: Rig, rows: Rows, known: int) -> None:
    rig.program.last_rows(rows.position[known:], rows.velocity[known:])
    give(rig, "resume")
    give(rig, 1.0)
    rig.run()
    assert np.array_equal(rig.setpoint[-1], rows.position[-1])


def assert_limits(rig: Rig, jerk: float | None) -> None:
    points = rig.setpoint
    assert_keeps(np.concatenate((points, np.tile(points[-1:], (3, 1)))), (VELOCITY, ACCELERATION, jerk))


@settings(max_examples=24)
@given(
    path=st.sampled_from(["line", "circle"]),
    speed=st.sampled_from([0.2, 0.4, 0.8]),
    jerk=st.sampled_from([None, JERK]),
    orders=st.one_of(
        st.lists(st.tuples(st.integers(1, 300), st.sampled_from(ORDERS)), max_size=10),
        st.lists(st.tuples(st.integers(1, 9), st.sampled_from(ORDERS)), min_size=20, max_size=60),
    ),
)
def test_any_sequence_of_orders_keeps_velocity_acceleration_and_jerk_on_the_path(
    path: str, speed: float, jerk: float | None, orders: list[tuple[int, str | float]]
) -> None:
    rig, rows = start(path, speed, jerk)
    for cycles, order in orders:
        rig.step(cycles)
        give(rig, order)
    give(rig, "resume")
    give(rig, 1.0)
    rig.run()
    assert_limits(rig, jerk)
    assert away_from(path, rig.setpoint) < 2e-8
    along = rig.setpoint[:, 0]
    if path == "circle":
        along = np.unwrap(np.arctan2(rig.setpoint[:, 1], RADIUS - along))
    assert np.diff(along).min() >= -1e-12, "backwards"
    assert np.array_equal(rig.setpoint[-1], rows.position[-1])


@settings(max_examples=16)
@given(
    jerk=st.sampled_from([None, JERK]),
    orders=st.lists(st.tuples(st.integers(1, 60), st.sampled_from(ORDERS)), max_size=30),
)
def test_any_sequence_of_orders_keeps_the_limits_of_rapids(
    jerk: float | None, orders: list[tuple[int, str | float]]
) -> None:
    rig = Rig(machine(jerk=None if jerk is None else 1000.0 * jerk))
    rig.program.rapid({0: 0.5, 1: -0.2})
    rig.program.wait(3)
    rig.program.finish()
    for cycles, order in orders:
        rig.step(cycles)
        give(rig, order)
    give(rig, "resume")
    give(rig, 1.0)
    rig.run()
    assert_limits(rig, jerk)
    assert rig.setpoint[-1].tolist() == [0.5, -0.2]


@pytest.mark.parametrize(("speed", "jerk"), [(0.05, None), (0.2, None), (0.8, None), (0.2, JERK)])
def test_a_hold_from_a_steady_speed_takes_no_longer_than_the_limits_ask(
    speed: float, jerk: float | None
) -> None:
    rig, _ = start("line", speed, jerk)
    rig.step(400)
    give(rig, "hold")
    cycles = 0
    while rig.executor.feedback.slots[0].state is not SlotState.HELD:
        rig.step()
        cycles += 1
        assert cycles < 1000
    least = speed / ACCELERATION + (0.0 if jerk is None else ACCELERATION / jerk)
    assert cycles * CYCLE_S <= least + 0.005
    assert_limits(rig, jerk)


@pytest.mark.parametrize("known", [17, 60, 120])
def test_a_motion_that_begins_with_few_rows_can_stop_before_the_last_of_them(known: int) -> None:
    # 17 rows of an s-curve: from 100 % no stop within them keeps the jerk limit
    rig, rows = start("line", 0.4, JERK, known)
    rig.step(1500)
    assert rig.executor.feedback.slots[0].rate == 0.0
    run_with_the_rest(rig, rows, known)
    assert_limits(rig, JERK)


@pytest.mark.parametrize("cycles", [68, 72, 76])
def test_a_hold_for_which_rows_leave_nothing_yet_waits_before_an_edge(cycles: int) -> None:
    # rows take all of the jerk while their acceleration falls, and the last known row comes near
    rig, rows = start("line", 0.8, JERK, 269)
    rig.step(cycles)
    give(rig, "hold")
    rig.step(600)
    assert rig.executor.feedback.slots[0].state is SlotState.HELD
    run_with_the_rest(rig, rows, 269)
    assert_limits(rig, JERK)


@pytest.mark.parametrize(("jerk", "known"), [(50.0, 169), (100.0, 105)])
def test_rows_that_take_all_of_the_jerk_are_begun_more_slowly_before_an_edge(jerk: float, known: int) -> None:
    rig, rows = start("circle", 0.4, jerk, known)
    rig.step(1500)
    assert rig.executor.feedback.slots[0].rate == 0.0
    assert rig.setpoint[-1, 1] != 0.0
    run_with_the_rest(rig, rows, known)
    assert_limits(rig, jerk)


def test_motion_that_stands_where_rows_take_all_of_the_jerk_goes_on_in_parts() -> None:
    rig, rows = start("line", 0.4, 50.0, 20)
    rig.step(800)
    run_with_the_rest(rig, rows, 20)
    assert_limits(rig, 50.0)


@pytest.mark.parametrize(("speed", "cycles", "before"), [(0.4, 20, 0.09), (0.4, 5, 0.06), (0.8, 2, 0.22)])
def test_a_hold_amid_a_ramp_that_takes_all_of_the_jerk_does_not_wait_for_its_end(
    speed: float, cycles: int, before: float
) -> None:
    rig, _ = start("line", speed, 50.0)
    rig.step(cycles)
    give(rig, "hold")
    rig.step(900)
    assert rig.executor.feedback.slots[0].state is SlotState.HELD
    assert rig.setpoint[-1, 0] < before
    give(rig, "resume")
    rig.run()
    assert_limits(rig, 50.0)


def test_a_hold_waits_for_rows_that_leave_some_jerk_while_there_is_room_before_the_edge() -> None:
    rig, rows = start("line", 0.4, 50.0, 515)
    rig.step(5)
    give(rig, 0.0)
    rig.step(1500)
    assert rig.executor.feedback.slots[0].rate == 0.0
    run_with_the_rest(rig, rows, 515)
    assert_limits(rig, 50.0)


def test_a_resumed_motion_is_played_by_whole_rows_again() -> None:
    rig, rows = start("line", 0.2, None)
    rig.step(403)
    give(rig, "hold")
    rig.step(200)
    give(rig, "resume")
    rig.step(100)
    latest = rig.setpoint[-1]
    assert (rows.position == latest).all(axis=1).any()


def test_an_abort_stops_on_the_path_drops_the_rest_and_holds() -> None:
    rig, _ = start("circle", 0.4, None)
    rig.step(400)
    rig.executor.mailbox.abort(0)
    stopped = rig.run_until(EventKind.STOPPED)
    rig.step(50)
    assert stopped.line == 1
    assert rig.executor.feedback.slots[0].state is SlotState.STOPPED
    assert not rig.of(EventKind.FINISHED)
    assert away_from("circle", rig.setpoint) < 2e-8
    assert rig.executor.executor.bank.energized == 3
    assert_limits(rig, None)


def test_an_emergency_stop_does_not_wait_for_the_jerk_limit() -> None:
    rig, _ = start("line", 0.4, 50.0)
    rig.step(600)
    rig.executor.mailbox.emergency_stop()
    rig.step(int(0.4 / ACCELERATION / CYCLE_S) + 8)
    points = rig.setpoint[-3:]
    assert np.array_equal(points[0], points[-1])
    assert np.abs(rig.acceleration()).max() <= 1.01 * ACCELERATION


@pytest.mark.parametrize("cycles", [40, 41, 300])
def test_a_rapid_comes_to_rest_in_an_emergency_before_its_axis_is_switched_off(cycles: int) -> None:
    # the last part of its way, less than a cycle, was left out
    rig = Rig(machine())
    rig.program.rapid({0: 0.7})
    rig.program.wait(1)
    rig.step(cycles)
    rig.executor.mailbox.emergency_stop()
    rig.run()
    rig.step(3)
    assert rig.executor.feedback.condition[0] == AxisCondition.OFF
    assert_limits(rig, None)


@pytest.mark.parametrize(("first", "second"), [(498, 688), (510, 705)])
def test_a_stop_on_the_last_known_row_keeps_a_low_jerk_limit_to_its_end(first: int, second: int) -> None:
    rig, rows = start("line", 0.8, 50.0, first)
    rig.step(1500)
    assert rig.executor.feedback.slots[0].rate == 0.0
    rig.program.rows(rows.position[first:second], rows.velocity[first:second], 3)
    rig.step(1500)
    assert rig.executor.feedback.slots[0].rate == 0.0
    assert_limits(rig, 50.0)
