"""Laws that hold for every program, on every machine, however the planner is asked to hand over."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from mcserver.motion.geometry.curves import ArcCurve
from mcserver.motion.pieces import Activation, Deactivation, LineEdges, Piece, Rows
from mcserver.units import MM
from tests.motion.measure import (
    ACCELERATION_SLACK,
    JERK_SLACK,
    VELOCITY_SLACK,
    acceleration_ratio,
    end_of,
    farthest_from_path,
    jerk_ratio,
    path_missed_by,
    row_velocity_ratio,
    speed_over_feed,
    velocity_ratio,
    vertices_of,
)
from tests.motion.programs import JERKS, Program, programs
from tests.motion.support import alike, at_speed, line_curve, plan

EXACT = 1e-9
# What the order of two moments on the time axis may miss [cycles].
ROUNDING = 1e-6


def law(examples: int) -> Any:
    """Settings of a law: repeatable, without a clock; a failing program is short enough as it is found."""
    return settings(
        phases=(Phase.explicit, Phase.generate),
        max_examples=examples,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
    )


@given(programs())
@law(35)
def test_no_axis_passes_its_velocity_or_acceleration_limit(program: Program) -> None:
    motion = plan(program.machine, program.moves, commits=program.commits)
    assert velocity_ratio(motion) <= VELOCITY_SLACK
    assert row_velocity_ratio(motion) <= VELOCITY_SLACK
    assert acceleration_ratio(motion) <= ACCELERATION_SLACK


@given(programs(jerks=JERKS[1:]))
@law(35)
def test_no_axis_passes_its_jerk_limit_but_at_a_vertex_passed_with_speed(program: Program) -> None:
    motion = plan(program.machine, program.moves, commits=program.commits)
    assert jerk_ratio(motion, vertices=vertices_of(motion)) <= JERK_SLACK


@given(programs(tolerances=(1e-5, 1e-4, 2e-3)))
@law(30)
def test_rounded_corners_keep_every_limit_and_the_tolerance(program: Program) -> None:
    motion = plan(program.machine, program.moves, commits=program.commits)
    tolerance = program.moves[0].tolerance
    assert velocity_ratio(motion) <= VELOCITY_SLACK
    assert acceleration_ratio(motion) <= ACCELERATION_SLACK
    assert jerk_ratio(motion, vertices=vertices_of(motion)) <= JERK_SLACK
    assert farthest_from_path(motion) <= tolerance
    fastest = max(axis.max_acceleration / axis.type.si_per_unit * MM for axis in program.machine.axes)
    # rows are points of the commanded path: between two of them it bows by a·dt²/8, about a vertex by a·dt²/4
    chord_error = np.sqrt(len(program.machine.axes)) * fastest * motion.cycle**2 / 4.0
    assert path_missed_by(motion) <= tolerance + chord_error


@given(programs())
@law(40)
def test_every_row_lies_on_the_programmed_path_and_the_last_one_on_its_end(program: Program) -> None:
    motion = plan(program.machine, program.moves, commits=program.commits)
    assert farthest_from_path(motion) <= EXACT
    end = end_of(program.machine, program.moves, motion.start)
    assert np.abs(motion.position[-1] - end).max() <= EXACT
    assert np.abs(motion.velocity[-1]).max() <= 1e-12


@given(programs(tolerances=(0.0, 1e-4, 2e-3)))
@law(50)
def test_path_speed_under_g94_never_passes_f(program: Program) -> None:
    motion = plan(program.machine, program.moves, commits=program.commits)
    assert speed_over_feed(motion) <= VELOCITY_SLACK


@given(programs(tolerances=(0.0, 1e-4)))
@law(30)
def test_output_is_in_order_of_time_and_says_when_lines_and_axes_begin_and_end(program: Program) -> None:
    motion = plan(program.machine, program.moves, commits=program.commits)
    assert np.isfinite(motion.position).all()
    assert np.isfinite(motion.velocity).all()
    assert sorted(motion.starts) == sorted(motion.ends) == list(range(1, len(program.moves) + 1))
    controls = [piece for piece in motion.pieces if not isinstance(piece, Rows)]
    at = [
        np.atleast_1d(piece.u)
        for piece in controls
        if isinstance(piece, LineEdges | Activation | Deactivation)
    ]
    assert (np.diff(np.concatenate(at)) >= -ROUNDING).all()
    assert all(motion.starts[line] <= motion.ends[line] for line in motion.starts)
    _assert_rows_stand_between_their_marks(motion.pieces)


def _assert_rows_stand_between_their_marks(pieces: list[Piece]) -> None:
    """A row is only put when its columns are active; no control stands before a row that was put."""
    active = 0
    last = 0
    for piece in pieces:
        if isinstance(piece, Rows):
            assert (piece.axes & np.uint64(active) == piece.axes).all()
            last = piece.first + len(piece.position) - 1
        elif isinstance(piece, Activation):
            active |= piece.mask
            assert piece.u >= last - ROUNDING
        elif isinstance(piece, Deactivation):
            active &= ~piece.mask
            assert piece.u >= last - ROUNDING


@given(programs(kinds=("line", "onward"), jerks=(None, 200_000.0)))
@law(30)
def test_motion_never_goes_back_along_a_line(program: Program) -> None:
    motion = plan(program.machine, program.moves, commits=program.commits)
    rows = np.concatenate([motion.start[None, :], motion.position])
    for number, move in enumerate(program.moves, start=1):
        curve = move.group.curves[0]
        columns = list(curve.axes)
        travel = np.subtract(curve.end, curve.start)  # type: ignore[attr-defined]
        low, high = int(np.ceil(motion.starts[number])), int(np.floor(motion.ends[number]))
        progress = rows[low : high + 1, columns] @ travel / (travel @ travel)
        assert (np.diff(progress) >= -1e-12 / np.linalg.norm(travel)).all()


@given(programs(kinds=("line", "onward", "arc"), tolerances=(0.0, 1e-4)))
@law(60)
def test_commits_change_when_the_motion_is_but_not_where(program: Program) -> None:
    whole = plan(program.machine, program.moves)
    committed = plan(program.machine, program.moves, commits=program.commits)
    assert np.abs(whole.position[-1] - committed.position[-1]).max() <= EXACT
    assert committed.duration >= whole.duration * (1.0 - 1e-3) - 2.0 * whole.cycle
    assert farthest_from_path(committed) <= program.moves[0].tolerance + EXACT


@given(st.data())
@law(20)
def test_a_program_planned_twice_is_the_same_to_the_last_bit(data: st.DataObject) -> None:
    program = data.draw(programs())
    first = plan(program.machine, program.moves, commits=program.commits)
    second = plan(program.machine, program.moves, commits=program.commits)
    assert (first.position == second.position).all()
    assert first.ends == second.ends


def test_the_measurements_see_a_limit_that_is_broken() -> None:
    machine = alike(2, velocity=200.0, acceleration=1000.0)
    weak = alike(2, velocity=100.0, acceleration=500.0, jerk=1000.0)
    motion = plan(machine, [at_speed(0.2, line_curve(machine, (0, 1), (0.0, 0.0), (0.2, 0.0)))])
    motion.machine = weak
    assert velocity_ratio(motion) == pytest.approx(2.0)
    assert acceleration_ratio(motion) == pytest.approx(2.0)
    assert jerk_ratio(motion) > 100.0


@pytest.mark.parametrize("jerk", [None, 1e5])
@pytest.mark.parametrize("shrunk", [1e-9, 5e-9, 2e-8])
def test_a_tiny_arc_whose_end_is_rounded_is_reached_within_the_limits(
    shrunk: float, jerk: float | None
) -> None:
    machine = alike(2, acceleration=500.0, jerk=jerk)
    length, radius, sweep = 5.0 * MM, 0.01 * MM, 0.02
    # the end of many arcs in files is off the circle by what was rounded: at their beginning is a vertex
    end = (
        length + (radius - shrunk) * math.sin(sweep),
        radius - (radius - shrunk) * math.cos(sweep),
    )
    spiral = ArcCurve(
        axes=(0, 1),
        start=(length, 0.0),
        end=end,
        centre=(length, radius),
        sweep=sweep,
        length=math.hypot(radius * sweep, shrunk),
    )
    line = line_curve(machine, (0, 1), (0.0, 0.0), (length, 0.0))
    motion = plan(machine, [at_speed(0.2, line), at_speed(0.2, spiral)])
    assert acceleration_ratio(motion) <= ACCELERATION_SLACK
