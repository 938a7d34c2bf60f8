"""Runs of lines and arcs: the planner makes of them what it makes of the same lines one by one."""

from __future__ import annotations

import math
from collections.abc import Callable
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup, MotionLine, PathBatch
from mcserver.motion.geometry.curves import ArcCurve, Curve
from mcserver.motion.geometry.segment import anchor, segment_of
from mcserver.motion.lookahead.setpoint_sampling import sample
from mcserver.motion.pieces import Piece
from mcserver.motion.planner import MotionPlanner
from tests.motion.measure import farthest_from_path
from tests.motion.support import Move, alike, collect
from tests.motion.test_laws import law


def contour(random: Random, count: int) -> list[str]:
    """Lines and arcs on end, smooth here and with corners there, some of them helices."""
    lines = ["G01 X0 Y0 Z1"]
    for _ in range(count):
        radius = random.choice((0.3, 2.0, 20.0))
        x, y = random.choice(((radius, 0.0), (0.0, radius), (-radius, 0.0)))
        match random.randrange(6):
            case 0:
                lines.append(f"G02 X{2 * x:g} Y{2 * y:g} I{x:g} J{y:g}")
            case 1:
                lines.append(f"G03 X{x - y:g} Y{y + x:g} I{x:g} J{y:g} Z{random.choice((0, 0.5))}")
            case 2:
                lines.append(f"G03 I{x:g} J{y:g}")
            case 3:
                lines.append(f"G18 G02 X{x:g} Z{x - y:g} R{1.5 * radius:g}" if x else f"G01 Z{y:g}")
            case _:
                lines.append(f"G01 X{random.uniform(-9, 9):.3f}" + random.choice(("", f" Y{y:g}", " Z0.1")))
    return [line.replace("G18 ", "") for line in lines]


def polyline(random: Random, count: int) -> list[str]:
    """Straight lines over the same axes, some of them far shorter than a cycle's way."""
    steps = (-50, -1, -0.05, 0.2, 3, 100)
    return [f"G01 X{random.choice(steps):g} Y{random.choice(steps):g}" for _ in range(count)]


def run_of(machine: Machine, lines: list[str], state: str = "G91 G94 F6000") -> PathBatch:
    interpreter = Interpreter(machine)
    interpreter.interpret_text(state, 1)
    found = interpreter.interpret_batch(lines, 2)
    assert found is not None
    (run,), taken = found.values, found.taken
    assert isinstance(run, PathBatch)
    assert taken == len(lines)
    return run


def one_by_one(machine: Machine, lines: list[MotionLine], feed_scale: float = 1.0) -> list[Piece]:
    planner = MotionPlanner(machine, np.zeros(len(machine.axes)))
    planner.feed_scale = feed_scale
    tolerance = 0.0
    for line in lines:
        (group,) = line.groups
        assert isinstance(group, FeedGroup)
        planner.append(planner.segment(group, line.line), tolerance=min(tolerance, line.tolerance))
        tolerance = line.tolerance
    return list(planner.close())


@given(
    st.integers(0, 2**32),
    st.sampled_from([contour, polyline]),
    st.sampled_from([None, 20_000.0]),
    st.booleans(),
    st.booleans(),
    st.sampled_from([1.0, 1.5]),
)
@law(15)
def test_a_run_is_planned_as_its_lines_one_by_one(
    seed: int,
    draw: Callable[[Random, int], list[str]],
    jerk: float | None,
    timed: bool,
    split: bool,
    feed_scale: float,
) -> None:
    machine = alike(4, jerk=jerk)
    lines = draw(Random(seed), 14)
    run = run_of(machine, lines, "G91 G93 F120" if timed else "G91 G94 F3000")
    planner = MotionPlanner(machine, np.zeros(4))
    planner.feed_scale = feed_scale
    if split:
        # behind a line that came before it
        (group,) = run.motion_lines()[0].groups
        assert isinstance(group, FeedGroup)
        planner.append(planner.segment(group, 2))
        interpreter = Interpreter(machine)
        interpreter.interpret_text("G91 G93 F120" if timed else "G91 G94 F3000", 1)
        interpreter.interpret_text(lines[0], 2)
        found = interpreter.interpret_batch(lines[1:], 3)
        assert found is not None
        assert planner.append_run(found.values[0])
    else:
        assert planner.append_run(run)
    assert planner.position[list(run.axes)] == pytest.approx(run.points[-1], abs=0)
    ours = collect(machine, [], np.zeros(4), list(planner.close()))
    theirs = collect(machine, [], np.zeros(4), one_by_one(machine, run.motion_lines(), feed_scale))
    assert ours.position == pytest.approx(theirs.position, abs=1e-9)
    assert ours.velocity == pytest.approx(theirs.velocity, abs=1e-6)
    assert ours.ends == pytest.approx(theirs.ends)
    # a row at the very end of a line may carry either (G93 ends on whole cycles), by the last bit of a time
    other = np.flatnonzero(ours.row_line != theirs.row_line)
    assert (np.abs(ours.row_line[other] - theirs.row_line[other]) == 1).all()
    assert (np.diff(other) > 1).all()
    same = np.delete(np.arange(len(ours.row_line)), other)
    assert (ours.row_mask[same] == theirs.row_mask[same]).all()


# of a curve, with words for the axes that change
CHORDS = [f"G01 X0.3 Y{0.01 * (number % 5 + 3):.2f}" + " Z0.01" * (number % 3 == 0) for number in range(30)]
CHORDS[20:24] = ["Y0.4", "X0.4", "Y0.4", "X0.3"]


@pytest.mark.parametrize("state", ["G91 G94 F3000 G64 P0.05", "G91 G93 F120 G64 P0.05"])
@pytest.mark.parametrize("lines", [contour(Random(7), 20), CHORDS], ids=["arcs", "chords"])
def test_a_run_with_a_tolerance_is_planned_as_its_lines_are(lines: list[str], state: str) -> None:
    machine = alike(4, jerk=50_000.0)
    run = run_of(machine, lines, state)
    planner = MotionPlanner(machine, np.zeros(4))
    assert planner.append_run(run)
    moves = [
        Move(group, tolerance=5e-5)
        for line in run.motion_lines()
        for group in line.groups
        if isinstance(group, FeedGroup)
    ]
    one, other = (
        collect(machine, moves, np.zeros(4), pieces)
        for pieces in (list(planner.close()), one_by_one(machine, run.motion_lines()))
    )
    assert one.starts.keys() == other.starts.keys()
    assert np.allclose(one.position, other.position, rtol=0.0, atol=1e-9)
    assert 1e-7 < farthest_from_path(one) <= 5e-5


def test_a_run_leaves_the_columns_that_it_does_not_name_where_they_are() -> None:
    machine = alike(3)
    planner = MotionPlanner(machine, np.array([0.0, 0.0, 0.5]))
    assert planner.append_run(run_of(machine, polyline(Random(1), 14)))
    motion = collect(machine, [], np.zeros(3), list(planner.close()))
    assert (motion.position[:, 2] == 0.5).all()
    assert (motion.row_mask == 0b011).all()


def test_a_run_with_a_line_that_does_not_travel_is_left_alone() -> None:
    machine = alike(3)
    planner = MotionPlanner(machine, np.zeros(3))
    assert not planner.append_run(
        run_of(machine, ["G1 X1", "G3 X2 I1", "G1 Y0", *["X1", "Y1"] * 6], "G91 F100")
    )
    assert planner.pending == 0
    assert planner.position.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    "curve",
    [
        ArcCurve((0, 1), (0.0, 0.0), (0.02, 0.0), (0.01, 0.0), -math.pi, 0.01 * math.pi),
        ArcCurve((2, 0, 1), (0.0, 0.0, 0.0), (0.0, 0.0, 0.03), (0.01, 0.0), 6.0 * math.pi, 0.2),
        ArcCurve((1, 2), (0.0, 0.0), (0.0, 0.020002), (0.0, 0.01), math.pi, 0.01 * math.pi),
    ],
)
def test_rows_of_an_arc_lie_on_its_curve(curve: Curve) -> None:
    machine = alike(4, jerk=20_000.0)
    planner = MotionPlanner(machine, np.zeros(4))
    segment = segment_of(
        FeedGroup((curve,), 1.0, None, 0.05), 1, {n: n for n in range(4)}, np.ones(4, np.bool_)
    )
    anchor(segment, np.zeros(4))
    planner.append(segment)
    run = planner._solved()
    rows = sample(run, 0.3, 1, math.ceil(run.phases.duration * 1000.0 + 0.3), 1e-3)
    assert rows.position[-1, list(curve.axes)].tolist() == list(curve.end)
    sigma, speed = run.phases.at((np.arange(1, len(rows.position) + 1) - 0.3) * 1e-3)[:2]
    s = np.clip(sigma / segment.scale, 0.0, 1.0)
    assert rows.position[:, list(curve.axes)] == pytest.approx(curve.position(s), abs=1e-12)
    slope = curve.derivatives(s)[0] * (speed / segment.scale)[:, None]
    assert rows.velocity[:, list(curve.axes)] == pytest.approx(slope, abs=1e-9)
    assert (rows.position[:, 3] == 0.0).all()
