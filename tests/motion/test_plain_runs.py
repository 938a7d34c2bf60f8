"""Runs of plain lines: the planner makes of them what it makes of the same lines one by one."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup, LineBatch
from mcserver.motion.geometry.curves import Array
from mcserver.motion.pieces import Piece
from mcserver.motion.planner import MotionPlanner
from tests.motion.measure import farthest_from_path
from tests.motion.support import Move, alike, collect, line_curve
from tests.motion.test_laws import law

STEPS = st.lists(
    st.tuples(*[st.sampled_from([-0.05, -1e-3, -5e-5, 2e-4, 3e-3, 0.1])] * 2), min_size=2, max_size=30
)


def run_of(points: Array, speed: float, *, timed: bool = False, first: int = 1) -> LineBatch:
    """Lines over the first axes from point to point, at a speed or with the time that this speed gives."""
    axes = tuple(range(points.shape[1]))
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return LineBatch(
        lines=np.arange(first, first + len(lengths)),
        axes=axes,
        points=points,
        lengths=lengths,
        travels=lengths,
        requested=lengths / speed,
        speeds=None if timed else np.full(len(lengths), speed),
    )


def one_by_one(machine: Machine, run: LineBatch) -> list[Piece]:
    planner = MotionPlanner(machine, np.zeros(len(machine.axes)))
    for line in run.motion_lines():
        group = line.groups[0]
        assert isinstance(group, FeedGroup)
        planner.append(planner.segment(group, line.line))
    return list(planner.close())


@given(STEPS, st.sampled_from([None, 20_000.0]), st.booleans(), st.integers(1, 10))
@law(20)
def test_a_run_is_planned_as_its_lines_one_by_one(
    steps: list[tuple[float, ...]], jerk: float | None, timed: bool, split: int
) -> None:
    machine = alike(3, jerk=jerk)
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(np.array(steps), axis=0)])
    whole = run_of(points, 0.1, timed=timed)
    split = min(split, len(whole) - 1)
    planner = MotionPlanner(machine, np.zeros(3))
    assert planner.append_run(run_of(points[: split + 1], 0.1, timed=timed))
    assert planner.append_run(run_of(points[split:], 0.1, timed=timed, first=split + 1))
    assert planner.position[:2].tolist() == points[-1].tolist()
    ours = collect(machine, [], np.zeros(3), list(planner.close()))
    theirs = collect(machine, [], np.zeros(3), one_by_one(machine, whole))
    assert ours.position == pytest.approx(theirs.position, abs=1e-12)
    assert ours.velocity == pytest.approx(theirs.velocity, abs=1e-9)
    assert ours.ends == pytest.approx(theirs.ends)
    assert (ours.row_line == theirs.row_line).all()
    assert (ours.row_mask == theirs.row_mask).all()


def test_a_run_with_a_line_that_does_not_travel_is_left_alone() -> None:
    machine = alike(2)
    planner = MotionPlanner(machine, np.zeros(2))
    points = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.0], [0.2, 0.0]])
    assert not planner.append_run(run_of(points, 0.1))
    assert planner.pending == 0
    assert planner.position.tolist() == [0.0, 0.0]


def test_a_run_leaves_the_columns_that_it_does_not_name_where_they_are() -> None:
    machine = alike(3)
    planner = MotionPlanner(machine, np.array([0.0, 0.0, 0.5]))
    assert planner.append_run(run_of(np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]]), 0.1))
    motion = collect(machine, [], np.zeros(3), list(planner.close()))
    assert (motion.position[:, 2] == 0.5).all()
    assert (motion.row_mask == 0b011).all()


def test_the_lines_of_a_run_are_the_lines_that_it_was_made_of() -> None:
    machine = alike(2)
    run = run_of(np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.2]]), 0.1)
    lines = run.motion_lines()
    assert [line.line for line in lines] == [1, 2]
    group = lines[1].groups[0]
    assert isinstance(group, FeedGroup)
    assert group.curves == (line_curve(machine, (0, 1), (0.1, 0.0), (0.1, 0.2)),)
    assert group.speed == 0.1
    assert group.requested == pytest.approx(2.0)


@pytest.mark.parametrize("timed", [False, True])
def test_a_run_with_a_tolerance_is_planned_as_its_lines_are_one_by_one(timed: bool) -> None:
    machine = alike(2, jerk=50_000.0)
    angles = np.linspace(0.0, 2.0, 41)
    points = 0.02 * np.stack([np.sin(angles), 1.0 - np.cos(angles)], axis=1)
    run = msgspec.structs.replace(run_of(points, 0.05, timed=timed), tolerance=1e-4)
    whole, single = MotionPlanner(machine, np.zeros(2)), MotionPlanner(machine, np.zeros(2))
    assert whole.append_run(run)
    for line in run.motion_lines():
        (group,) = line.groups
        assert isinstance(group, FeedGroup)
        single.append(single.segment(group, line.line), tolerance=0.0 if line.line == run.line else 1e-4)
    first, second = list(whole.close()), list(single.close())
    moves = [Move(group, tolerance=1e-4) for line in run.motion_lines() for group in line.groups]
    one, other = (collect(machine, moves, np.zeros(2), pieces) for pieces in (first, second))
    assert one.starts.keys() == other.starts.keys()
    assert np.allclose(one.position, other.position, rtol=0.0, atol=1e-12)
    assert farthest_from_path(one) <= 1e-4
    assert farthest_from_path(one) > 1e-7
