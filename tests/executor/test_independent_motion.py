"""G00, G1020, G1030, G1040: one axis each, at its own limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.fault_codes import WARNINGS
from tests.executor.rig import CYCLE_S, Rig, machine
from tests.limits import assert_keeps

ACCELERATION = 10.0


def within_limits(rig: Rig, column: int, *, jerk: float | None = None) -> None:
    assert_keeps(rig.setpoint[:, column], (1.0, ACCELERATION, jerk))


def test_a_rapid_energizes_and_each_axis_takes_its_own_time() -> None:
    rig = Rig(machine(jerk=200000.0))
    program = rig.program
    program.start_line(1)
    program.rapid({0: 0.5, 1: -0.1})
    program.wait(3)
    rig.play(line=True)
    assert rig.setpoint[-1].tolist() == [0.5, -0.1]
    within_limits(rig, 0, jerk=200.0)
    within_limits(rig, 1, jerk=200.0)
    # the time-optimal jerk-limited move of 0.5 m: v/a + a/j + s/v
    assert rig.time_of(EventKind.LINE_END, 1) == pytest.approx(0.1 + 0.05 + 0.5, abs=1e-9)


def test_a_wait_for_a_rapid_ends_with_the_cycle_in_which_it_is_over() -> None:
    """Rows stand at whole u: what follows a wait starts with a cycle, so that they are played as they are."""
    rig = Rig(machine())
    program = rig.program
    for line, target in ((1, 0.123456), (2, 0.0)):
        program.start_line(line)
        program.rapid({0: target})
        program.wait(1)
        program.end_line()
    rig.play()
    duration = math.ceil((0.1 + 0.123456) / 0.001) * 0.001
    assert rig.time_of(EventKind.LINE_END, 1) == pytest.approx(duration, abs=1e-9)
    assert rig.time_of(EventKind.LINE_END, 2) == pytest.approx(2 * duration, abs=1e-9)


def test_a_servo_move_does_not_hold_the_program() -> None:
    rig = Rig(machine())
    program = rig.program
    program.start_line(1)
    program.rapid({0: 0.5})
    program.end_line()
    program.start_line(2)
    program.dwell(0.01)
    rig.play(line=True)
    assert rig.time_of(EventKind.LINE_END, 1) == 0.0
    assert rig.time_of(EventKind.LINE_END, 2) == pytest.approx(0.01)
    assert rig.setpoint[-1, 0] == 0.5


@settings(max_examples=30)
@given(
    moves=st.lists(
        st.tuples(st.floats(-0.4, 0.4), st.floats(0.0, 0.25), st.sampled_from(["rapid", "speed", "halt"])),
        min_size=2,
        max_size=6,
    ),
    jerk=st.sampled_from([None, 200000.0]),
)
# superseded in the cycle in which it came to rest, before that
@example(moves=[(0.0, 0.0, "rapid"), (0.0703125, 0.16731270003088242, "rapid")], jerk=None)
def test_superseding_a_moving_axis_keeps_its_limits(
    moves: list[tuple[float, float, str]], jerk: float | None
) -> None:
    rig = Rig(machine(jerk=jerk))
    program = rig.program
    for value, pause, kind in moves:
        if kind == "rapid":
            program.rapid({0: value})
        elif kind == "speed":
            program.speed({0: 2.0 * value})
        else:
            program.control(ControlKind.HALT_AXES, axes=1)
        program.dwell(pause)
    program.rapid({0: 0.05})
    program.wait(1)
    rig.play()
    assert rig.setpoint[-1, 0] == 0.05
    within_limits(rig, 0, jerk=None if jerk is None else 200.0)
    assert np.abs(rig.setpoint[:, 0]).max() <= 1.0


def test_halting_axes_reports_where_they_stand() -> None:
    rig = Rig(machine())
    program = rig.program
    program.rapid({0: 0.8})
    program.dwell(0.2)
    program.control(ControlKind.HALT_AXES, axes=1)
    program.control(ControlKind.SETTLE, axes=1, token=42)
    settled = rig.run_until(EventKind.SETTLED)
    assert settled.token == 42
    position = 0.5 * 0.1 + 0.1 + 0.05
    assert settled.values[0] == pytest.approx(position, abs=1e-4)
    assert settled.values[2] == settled.values[0]
    rig.step(20)
    assert rig.setpoint[-1, 0] == settled.values[0]
    within_limits(rig, 0)


def test_a_speed_is_reached_within_limits_and_held() -> None:
    rig = Rig(machine(travel=None))
    program = rig.program
    program.start_line(1)
    program.speed({0: 0.5, 1: -9.0})
    program.end_line()
    program.finish()
    rig.step(500)
    velocity = np.diff(rig.setpoint, axis=0)[-1] / CYCLE_S
    assert velocity == pytest.approx([0.5, -1.0])
    assert rig.time_of(EventKind.LINE_END, 1) == 0.0
    assert rig.executor.at_rest
    within_limits(rig, 0)


def test_a_held_speed_stops_on_the_soft_limit_and_says_so() -> None:
    rig = Rig(machine(travel=200.0, jerk=200000.0))
    program = rig.program
    program.start_line(4)
    program.speed({0: 0.7})
    program.end_line()
    warning = rig.run_until(EventKind.FAULT)
    rig.step(500)
    assert (warning.code, warning.axis) == (423, 0)
    assert warning.code in WARNINGS
    assert rig.setpoint[-1, 0] == pytest.approx(0.2, abs=1e-12)
    assert rig.setpoint[:, 0].max() <= 0.2 + 1e-9
    within_limits(rig, 0)
    assert len(rig.of(EventKind.FAULT)) == 1


def test_a_rapid_beyond_the_travel_is_refused_before_anything_moves() -> None:
    rig = Rig(machine(travel=200.0))
    program = rig.program
    program.start_line(2)
    program.rapid({1: 0.1, 0: 0.3})
    fault = rig.run_until(EventKind.FAULT)
    rig.run()
    assert (fault.code, fault.axis, fault.line) == (404, 0, 2)
    assert np.all(rig.setpoint == 0.0)


def test_feed_hold_stops_a_rapid_within_its_acceleration_and_resume_goes_on() -> None:
    rig = Rig(machine())
    program = rig.program
    program.rapid({0: 0.9})
    program.wait(1)
    program.finish()
    rig.step(300)
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(111)
    held = rig.setpoint[-1, 0]
    rig.step(100)
    assert rig.setpoint[-1, 0] == held
    rig.executor.mailbox.resume(0)
    rig.run()
    assert rig.setpoint[-1, 0] == 0.9
    within_limits(rig, 0)


def test_overrides_slow_rapids_down_but_never_speed_them_up() -> None:
    times = []
    for ratio in (0.5, 1.0, 2.0):
        rig = Rig(machine())
        rig.executor.mailbox.set_override(ratio, 0)
        rig.program.rapid({0: 0.4})
        rig.program.wait(1)
        rig.program.finish()
        times.append(rig.run())
    assert times[1] == times[2]
    # half the speed at the same acceleration: 0.4 m at 0.5 m/s and 10 m/s²
    assert times[0] - times[1] == pytest.approx((0.85 - 0.5) / CYCLE_S, abs=2)


def test_a_torque_accelerates_a_simulated_axis_and_abort_brings_it_to_rest() -> None:
    rig = Rig(machine(drive="simulated", travel=None, drive_keys="inertia = 0.001\nfriction_decel = 1.0"))
    program = rig.program
    program.start_line(1)
    program.torque({0: 1.0})
    program.end_line()
    rig.step(200)
    # 1 N·m on 0.001 kg·m² turn 10 mm a revolution
    expected = 1000.0 * 0.01 / (2 * np.pi) - 0.001
    acceleration = np.diff(rig.actual[50:150, 0], 2).mean() / CYCLE_S**2
    assert acceleration == pytest.approx(expected, rel=1e-3)
    rig.executor.mailbox.abort(0)
    rig.run_until(EventKind.STOPPED)
    rig.step(100)
    assert np.abs(np.diff(rig.actual[-20:, 0])).max() < 1e-9
    assert np.abs(rig.setpoint[-1, 0] - rig.actual[-1, 0]) < 1e-6


def test_a_speed_command_on_a_simulated_axis_ends_without_a_jump() -> None:
    rig = Rig(machine(drive="simulated", travel=None))
    program = rig.program
    program.speed({0: 0.5})
    program.dwell(0.3)
    program.control(ControlKind.HALT_AXES, axes=1)
    rig.play()
    within_limits(rig, 0)


def test_independent_motion_outlives_its_program() -> None:
    rig = Rig(machine())
    rig.program.rapid({0: 0.5})
    rig.program.finish()
    rig.run_until(EventKind.FINISHED)
    assert not rig.executor.at_rest
    rig.run()
    assert rig.setpoint[-1, 0] == 0.5


def test_a_coordinated_motion_on_an_axis_under_way_is_refused() -> None:
    rig = Rig(machine())
    program = rig.program
    program.rapid({0: 0.5})
    program.dwell(0.05)
    program.start_line(8)
    program.move({0: 0.1}, 100)
    fault = rig.run_until(EventKind.FAULT)
    assert (fault.code, fault.axis, fault.line) == (403, 0, 8)


@settings(max_examples=20)
@given(hold_at=st.integers(5, 600), halt_after=st.integers(0, 120), jerk=st.sampled_from([None, 200000.0]))
def test_superseding_a_rapid_while_its_rate_changes_keeps_its_limits(
    hold_at: int, halt_after: int, jerk: float | None
) -> None:
    rig = Rig(machine(jerk=jerk))
    program = rig.program
    program.rapid({0: 0.5})
    program.dwell((hold_at + 40) * CYCLE_S)
    program.rapid({0: -0.2})
    program.finish()
    rig.step(hold_at)
    rig.executor.mailbox.set_override(0.1, 0)
    rig.step(halt_after)
    rig.executor.mailbox.set_override(1.0, 0)
    rig.run()
    assert rig.setpoint[-1, 0] == -0.2
    within_limits(rig, 0)
