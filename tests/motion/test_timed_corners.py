"""Bends of lines with a T of their own: passed with speed, and every T kept (D-33, D-36)."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.canonical import FeedGroup
from mcserver.simulation.simulation import simulate
from tests.motion.measure import assert_kept
from tests.motion.support import Commit, Move, alike, at_speed, in_time, line_curve, plan
from tests.motion.test_laws import law

TOLERANCE = 1e-4


def chain(machine: Machine, turns: list[float], times: list[float], length: float) -> list[FeedGroup]:
    """Timed lines in a plane; each turns away from the one before by an angle [deg]."""
    groups, position, heading = [], np.zeros(2), 0.0
    for turn, time in zip(turns, times, strict=True):
        heading += math.radians(turn)
        end = position + length * np.array([math.cos(heading), math.sin(heading)])
        groups.append(in_time(time, line_curve(machine, (0, 1), position.tolist(), end.tolist())))
        position = end
    return groups


@pytest.mark.parametrize("angle", [0.5, 6.0, 12.0, 40.0])
def test_a_bend_of_a_timed_chain_is_passed_with_speed_and_each_line_keeps_its_time(angle: float) -> None:
    machine = alike(2, jerk=50_000.0)
    groups = chain(machine, [0.0, angle, -angle, angle, angle], [0.5] * 5, 0.05)
    motion = plan(machine, [Move(group, tolerance=TOLERANCE) for group in groups])
    assert_kept(motion, TOLERANCE)
    for line in range(1, 6):
        assert motion.took(line) == pytest.approx(0.5, abs=1e-9)
    speed = np.linalg.norm(np.diff(motion.position, axis=0), axis=1) / motion.cycle
    at_bends = [speed[round(motion.ends[line]) - 1] for line in range(1, 5)]
    assert min(at_bends) > (0.09 if angle <= 6.0 else 0.01)


def test_timed_chords_of_a_circle_are_one_curve_without_a_ripple_of_speed() -> None:
    machine = alike(2, jerk=50_000.0)
    angles = np.linspace(0.0, 4.0, 81)
    points = 0.02 * np.stack([np.sin(angles), 1.0 - np.cos(angles)], axis=1)
    groups = [
        in_time(0.02 if 0 < number < 79 else 0.2, line_curve(machine, (0, 1), a.tolist(), b.tolist()))
        for number, (a, b) in enumerate(itertools.pairwise(points))
    ]
    motion = plan(machine, [Move(group, tolerance=TOLERANCE) for group in groups])
    assert_kept(motion, TOLERANCE)
    for line in range(8, 72):
        assert motion.took(line) == pytest.approx(0.02, abs=1e-6)
    speed = np.linalg.norm(np.diff(motion.position, axis=0), axis=1) / motion.cycle
    inside = speed[round(motion.ends[8]) : round(motion.ends[72])]
    assert inside.max() <= 1.03 * inside.min()


@given(st.data())
@law(25)
def test_rounding_never_makes_a_timed_chain_later_than_its_stops_do(data: st.DataObject) -> None:
    jerk = data.draw(st.sampled_from([20_000.0, 200_000.0]))
    machine = alike(2, velocity=300.0, acceleration=2000.0, jerk=jerk)
    count = data.draw(st.integers(2, 6))
    turns = [data.draw(st.sampled_from([0.3, 3.0, 10.0, 45.0, 100.0, -6.0])) for _ in range(count)]
    each = st.sampled_from([0.08, 0.2, 0.5])
    times = [data.draw(each)] * count
    most = 1.0 + 1e-6
    if data.draw(st.booleans()):
        # a step of speed has to be made somewhere: with a curve over the vertex there is less room for it
        times, most = [data.draw(each) for _ in range(count)], 1.05
    groups = chain(machine, turns, times, data.draw(st.sampled_from([0.002, 0.02, 0.05])))
    commits = [Commit(after, 50.0) for after in range(1, count) if data.draw(st.booleans())]
    rounded = plan(machine, [Move(group, tolerance=TOLERANCE) for group in groups], commits=commits)
    assert_kept(rounded, TOLERANCE)
    stopping = plan(machine, [Move(group, from_rest=True) for group in groups])
    assert rounded.duration <= stopping.duration * most


def test_a_timed_line_between_lines_with_a_speed_is_rounded_at_both_ends() -> None:
    machine = alike(2, jerk=50_000.0)
    points = [(0.0, 0.0), (0.1, 0.0), (0.2, 0.01), (0.3, 0.0)]
    curves = [line_curve(machine, (0, 1), a, b) for a, b in itertools.pairwise(points)]
    groups = [at_speed(0.1, curves[0]), in_time(1.0, curves[1]), at_speed(0.1, curves[2])]
    motion = plan(machine, [Move(group, tolerance=TOLERANCE) for group in groups])
    assert_kept(motion, TOLERANCE)
    assert motion.took(2) == pytest.approx(1.0, abs=1e-9)
    speed = np.linalg.norm(np.diff(motion.position, axis=0), axis=1) / motion.cycle
    assert min(speed[round(motion.ends[line]) - 1] for line in (1, 2)) > 0.05


def test_short_timed_lines_flow_from_rest_as_feed_lines_do() -> None:
    machine = alike(2, jerk=50_000.0)
    angles = np.linspace(0.0, 4.0, 401)
    points = 0.02 * np.stack([np.sin(angles), 1.0 - np.cos(angles)], axis=1)
    lines = [line_curve(machine, (0, 1), a.tolist(), b.tolist()) for a, b in itertools.pairwise(points)]
    timed = plan(machine, [Move(in_time(line.length / 0.08, line), tolerance=TOLERANCE) for line in lines])
    assert_kept(timed, TOLERANCE)
    fed = plan(machine, [Move(at_speed(0.08, line), tolerance=TOLERANCE) for line in lines])
    assert timed.duration <= 1.05 * fed.duration
    # those of the ramps alone are late
    assert len(timed.bounds) <= 120


def test_a_line_whose_time_is_too_short_does_not_stop_the_flow() -> None:
    machine = alike(2, velocity=100.0, jerk=50_000.0)
    groups = chain(machine, [0.0] * 9, [0.25, 0.25, 0.25, 0.25, 0.1, 0.25, 0.25, 0.25, 0.25], 0.02)
    motion = plan(machine, [Move(group, tolerance=TOLERANCE) for group in groups])
    assert_kept(motion, TOLERANCE)
    # at 100 mm/s all along, but for the way to it
    assert 0.2 <= motion.took(5) <= 0.206
    assert set(motion.bounds) <= {1, 5, 9}
    speed = np.linalg.norm(np.diff(motion.position, axis=0), axis=1) / motion.cycle
    assert speed[round(motion.ends[1]) : round(motion.ends[8])].min() > 0.05


TOOL_CIRCLE = "arm6", "T1", (460.0, 0.0), "X{0:.4f} Y{1:.4f} Z675", 65.0, 50.0, 120, 0.1
FOOT_CIRCLE = "robot-dog", "T3", (-400.0, 0.0), "X-159 Y{0:.4f} Z{1:.4f}", 40.0, 200.0, 36, 0.5


@pytest.mark.parametrize("circle", [TOOL_CIRCLE, FOOT_CIRCLE])
def test_timed_chords_of_a_tool_flow_as_those_with_a_feed_rate_do(
    circle: tuple[str, str, tuple[float, float], str, float, float, int, float],
) -> None:
    name, tool, (x, y), words, radius, speed, count, tolerance = circle
    machine = load_machine(name)
    chord = 2.0 * radius * math.sin(math.pi / count)
    times: list[float] = []
    for mode, feed in (("G94", 60.0 * speed), ("G93", 60.0 * speed / chord)):
        text = ["G1010", f"{tool} {mode} G64 P{tolerance}"]
        for index in range(1, count // 3 + 1):
            angle = 2.0 * math.pi * index / count
            place = x + radius * (1.0 - math.cos(angle)), y + radius * math.sin(angle)
            text.append(f"G01 {words.format(*place)} F{feed:.4f}")
        found = simulate("\n".join(text), machine, kinematics=build_kinematics(machine), record=True)
        assert found.report["ok"]
        assert found.recording is not None
        times.append(found.report["duration_s"])
    assert times[1] <= 1.01 * times[0]
    rates = np.linalg.norm(np.diff(found.recording.setpoint, axis=0), axis=1)
    moving = np.flatnonzero(rates > 0.1 * np.median(rates))
    assert rates[moving[0] : moving[-1]].min() > 0.1 * np.median(rates)
