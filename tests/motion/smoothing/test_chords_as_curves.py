"""Many chords as one curve: as quick as what they stand for, within the tolerance and every limit."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.path_columns import PathColumns
from mcserver.motion.geometry.segment import AxisLimits, anchor, segment_of
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.pieces import Piece
from mcserver.motion.planner import MotionPlanner
from mcserver.motion.smoothing.chord_smoothing import ChordSmoother, SmoothRun
from tests.motion.measure import assert_kept, farthest_from_path
from tests.motion.support import (
    AxisSpec,
    Commit,
    Motion,
    Move,
    alike,
    arc_curve,
    at_speed,
    collect,
    line_curve,
    machine_of,
    plan,
    polyline,
)
from tests.motion.test_laws import law

JERK = 50_000.0


def circle(radius: float, chord: float, turn: float) -> Array:
    """Points of a circle from the origin, rounded as a program writes them [m]."""
    angles = np.arange(round(turn * radius / chord) + 1) * chord / radius
    points = np.column_stack((radius * np.sin(angles), radius * (1.0 - np.cos(angles))))
    rounded: Array = np.round(points, 7)
    return rounded


def rounded(
    machine: Machine, points: Array, speed: float, tolerance: float, commits: Sequence[Commit] = ()
) -> Motion:
    moves = [Move(group, tolerance=tolerance) for group in polyline(machine, points.tolist(), speed)]
    start = np.pad(points[0], (0, len(machine.axes) - points.shape[1]))
    return plan(machine, moves, start=start, commits=commits)


@pytest.mark.parametrize(
    ("radius", "chord", "tolerance"),
    [(0.01, 5e-4, 1e-5), (0.02, 2e-3, 5e-5), (0.002, 2e-4, 2e-5), (0.1, 2e-3, 1e-5)],
)
def test_chords_of_a_circle_take_hardly_longer_than_the_circle(
    radius: float, chord: float, tolerance: float
) -> None:
    machine = alike(2, jerk=JERK)
    points = circle(radius, chord, 0.1 / radius)
    motion = rounded(machine, points, 0.1, tolerance)
    assert_kept(motion, tolerance)
    turn = (len(points) - 1) * chord / radius
    arc = plan(machine, [at_speed(0.1, arc_curve((0.0, 0.0), (0.0, radius), turn))])
    assert motion.duration <= 1.10 * arc.duration


@pytest.mark.parametrize(
    ("radius", "tolerances", "share"),
    # a circle lies between chords and vertices up to two tolerances; beyond, the curve has to bend about it
    [(0.02, 1.9, 1.05), (0.02, 2.3, 1.25), (0.02, 4.0, 1.8), (0.02, 6.5, 2.4), (0.005, 2.0, 1.15)],
)
def test_chords_that_miss_the_circle_by_some_tolerances_bend_no_more_than_they_have_to(
    radius: float, tolerances: float, share: float
) -> None:
    machine = alike(2, jerk=JERK)
    chord = 2e-3
    points = circle(radius, chord, 0.1 / radius)
    tolerance = chord**2 / (8.0 * radius * tolerances)
    motion = rounded(machine, points, 0.1, tolerance)
    assert_kept(motion, tolerance)
    turn = (len(points) - 1) * chord / radius
    arc = plan(machine, [at_speed(0.1, arc_curve((0.0, 0.0), (0.0, radius), turn))])
    assert motion.duration <= share * arc.duration


def test_each_line_is_reported_once_in_order_and_ends_on_its_target() -> None:
    machine = alike(2, jerk=JERK)
    points = circle(0.01, 5e-4, 2.0)
    motion = rounded(machine, points, 0.1, 1e-5)
    count = len(points) - 1
    assert list(motion.starts) == list(motion.ends) == list(range(1, count + 1))
    for line in range(1, count):
        assert motion.ends[line] == motion.starts[line + 1]
    assert (motion.position[-1] == points[-1]).all()


def smoothed() -> SmoothRun:
    """A hundred chords as one curve."""
    machine = alike(3, jerk=JERK)
    points = np.column_stack((circle(0.01, 3e-4, 3.0), np.linspace(0.0, 2e-3, 101)))
    slots, linear, position = {0: 0, 1: 1, 2: 2}, np.ones(3, np.bool_), points[0].copy()
    lines = []
    for number, group in enumerate(polyline(machine, points.tolist(), 0.1), start=1):
        lines.append(segment_of(group, number, slots, linear))
        anchor(lines[-1], position)
        lines[-1].tolerance = 1e-5
    (curve,) = ChordSmoother(AxisLimits.of(machine)).smooth(SegmentList(lines), rests=True)
    assert isinstance(curve, SmoothRun)
    return curve


def test_parts_of_a_curve_are_the_same_in_columns_and_as_objects() -> None:
    parts = smoothed().parts
    objects, columns = PathColumns.of(list(parts)), parts.columns(0, len(parts))
    for name in (
        "line",
        "active",
        "opens",
        "closes",
        "feed_scale",
        "kind",
        "spans",
        "bases",
        "ends",
        "domains",
    ):
        assert np.array_equal(getattr(objects, name), getattr(columns, name))
    assert (
        [each[2:] for each in columns.splines] == [each[2:] for each in objects.splines] == [(0, len(parts))]
    )
    for name in ("mask", "fed", "duration", "feed", "requested", "feed_speed", "tolerance"):
        assert np.array_equal(getattr(objects, name), getattr(columns, name), equal_nan=True)


def test_parts_of_a_curve_meet_with_three_equal_derivatives() -> None:
    curve = smoothed()
    assert [part.line for part in curve.parts] == list(range(1, 101))
    for before, after in itertools.pairwise(curve.parts):
        (one,), (two,) = before.curves, after.curves
        scale = two.high - two.low, one.high - one.low  # type: ignore[attr-defined]
        assert one.position(np.array([1.0])) == pytest.approx(two.position(np.array([0.0])), abs=1e-15)
        for order, (last, first) in enumerate(
            zip(one.derivatives(np.array([1.0])), two.derivatives(np.array([0.0])), strict=True), start=1
        ):
            size = np.abs(last).max() / scale[1] ** order
            assert last / scale[1] ** order == pytest.approx(
                first / scale[0] ** order, abs=1e-6 * size + 1e-9
            )


def test_a_corner_that_is_meant_stays_one_within_the_tolerance() -> None:
    """Two arcs of chords that meet at a right angle: the curve is rounded there, and not cut short."""
    machine = alike(2, jerk=JERK)
    first = circle(0.01, 5e-4, math.pi / 2.0)
    second = first[-1] + circle(0.01, 5e-4, math.pi / 2.0)
    motion = rounded(machine, np.concatenate((first, second[1:])), 0.1, 2e-5)
    assert_kept(motion, 2e-5)


def test_lines_beside_chords_are_joined_without_a_stop() -> None:
    machine = alike(2, jerk=JERK)
    arc = circle(0.02, 5e-4, math.pi / 2.0)
    points = np.concatenate(([[-0.05, 0.0]], arc, [arc[-1] + (0.0, 0.05)]))
    motion = rounded(machine, points, 0.1, 2e-5)
    assert_kept(motion, 2e-5)
    speeds = np.linalg.norm(motion.velocity, axis=1)
    middle = slice(len(speeds) // 4, 3 * len(speeds) // 4)
    assert speeds[middle].min() >= 0.09


def test_all_axes_are_smoothed_and_a_degree_counts_as_a_millimetre() -> None:
    machine = machine_of(
        [
            AxisSpec(200.0, 2000.0, JERK),
            AxisSpec(200.0, 2000.0, JERK),
            AxisSpec(360.0, 7200.0, JERK, rotary=True),
        ]
    )
    points = circle(0.01, 5e-4, 3.0)
    angles = np.radians(20.0) * np.sin(np.linspace(0.0, 3.0, len(points)))
    moves = []
    path = np.column_stack((points, angles))
    for before, after in itertools.pairwise(path.tolist()):
        moves.append(Move(at_speed(0.05, line_curve(machine, (0, 1, 2), before, after)), tolerance=5e-5))
    motion = plan(machine, moves)
    assert_kept(motion, 5e-5)
    assert np.linalg.norm(motion.velocity[:, :2], axis=1)[100:-100].min() >= 0.04


@pytest.mark.parametrize("every", [1, 3, 17, 60])
@pytest.mark.parametrize("ahead", [20.0, 200.0, math.inf])
def test_a_curve_that_comes_piece_by_piece_keeps_limits_and_tolerance(every: int, ahead: float) -> None:
    machine = alike(2, jerk=JERK)
    points = circle(0.01, 5e-4, 6.0)
    commits = [Commit(after, ahead) for after in range(every, len(points), every)]
    motion = rounded(machine, points, 0.1, 1e-5, commits=commits)
    assert_kept(motion, 1e-5)
    assert sorted(motion.starts) == sorted(motion.ends) == list(range(1, len(points)))
    assert (motion.position[-1] == points[-1]).all()


def test_a_curve_that_comes_in_time_does_not_stop_where_its_pieces_meet() -> None:
    machine = alike(2, jerk=JERK)
    points = circle(0.01, 5e-4, 12.0)
    commits = [Commit(after, 20.0) for after in range(60, len(points), 20)]
    whole = rounded(machine, points, 0.1, 1e-5)
    motion = rounded(machine, points, 0.1, 1e-5, commits=commits)
    assert_kept(motion, 1e-5)
    assert motion.duration <= 1.10 * whole.duration


def test_without_a_tolerance_the_chords_are_exact() -> None:
    machine = alike(2, jerk=JERK)
    motion = rounded(machine, circle(0.01, 5e-4, 1.0), 0.1, 0.0)
    assert farthest_from_path(motion) <= 1e-12


def test_the_window_says_how_many_lines_wait_in_it() -> None:
    machine = alike(2, jerk=JERK)
    planner = MotionPlanner(machine, np.zeros(2))
    for number, group in enumerate(polyline(machine, circle(0.01, 5e-4, 1.0).tolist(), 0.1), start=1):
        planner.append(planner.segment(group, number), tolerance=1e-5)
        assert planner.pending == number


@st.composite
def chord_programs(draw: st.DrawFn) -> tuple[Array, float, float, float, float]:
    """Chords under a curvature that changes from place to place, with corners and long lines between."""
    heading, place, points = 0.0, np.zeros(2), [np.zeros(2)]
    for _ in range(draw(st.integers(2, 5))):
        chord = draw(st.sampled_from([1e-4, 3e-4, 1e-3, 2e-3]))
        curvature = draw(st.sampled_from([0.0, 10.0, -60.0, 200.0, -500.0]))
        growth = draw(st.sampled_from([0.0, 0.0, 1.0, -1.0])) * curvature
        heading += draw(st.sampled_from([0.0, 0.0, 0.2, -0.5, 1.5]))
        count = draw(st.integers(2, 25))
        for index in range(count):
            heading += chord * (curvature + growth * index / count)
            place = place + chord * np.array([math.cos(heading), math.sin(heading)])
            points.append(place)
        if draw(st.booleans()):
            place = place + draw(st.sampled_from([5e-3, 0.03])) * np.array(
                [math.cos(heading), math.sin(heading)]
            )
            points.append(place)
    digits = draw(st.sampled_from([6, 7]))
    tolerance = draw(st.sampled_from([1e-5, 3e-5, 1e-4]))
    return (
        np.round(points, digits),
        tolerance,
        draw(st.sampled_from([0.03, 0.1, 0.3])),
        draw(st.sampled_from([500.0, 2000.0, 10_000.0])),
        draw(st.sampled_from([30_000.0, 100_000.0])),
    )


@given(chord_programs(), st.sampled_from([0, 1, 7, 30]), st.sampled_from([20.0, 300.0, math.inf]))
@law(20)
def test_any_chords_keep_every_limit_at_every_cycle_and_the_tolerance(
    program: tuple[Array, float, float, float, float], every: int, ahead: float
) -> None:
    points, tolerance, speed, acceleration, jerk = program
    machine = alike(2, acceleration=acceleration, jerk=jerk)
    commits = [Commit(after, ahead) for after in range(every, len(points), every)] if every else []
    motion = rounded(machine, points, speed, tolerance, commits=commits)
    assert_kept(motion, tolerance)
    assert sorted(motion.starts) == sorted(motion.ends) == list(range(1, len(points)))


@pytest.mark.parametrize("between", ["stop", "exact run"])
def test_a_curve_that_has_ended_at_rest_does_not_go_on_behind_what_follows_it(between: str) -> None:
    machine = alike(2, jerk=JERK)
    points = circle(0.02, 5e-4, 0.2)
    further = points[-1] + np.array([[0.0, 0.05], [0.05, 0.05], [0.051, 0.0501]])
    groups = polyline(machine, np.concatenate((points, further)).tolist(), 0.1)
    planner = MotionPlanner(machine, np.zeros(2))
    count = len(points) - 1
    for number, group in enumerate(groups, start=1):
        stops = between == "stop" and number == count + 1
        exact = between == "exact run" and number == count + 1
        segment = planner.segment(group, number)
        planner.append(segment, from_rest=stops, tolerance=0.0 if exact else 1e-4)
    motion = collect(
        machine, [Move(group, tolerance=1e-4) for group in groups], np.zeros(2), list(planner.close())
    )
    assert_kept(motion, 1e-4)
    assert list(motion.starts) == list(range(1, len(groups) + 1))


def test_a_curve_longer_than_the_window_is_driven_to_its_end_without_a_stop() -> None:
    """1500 chords of 0.1 mm, handed over as soon as the window is full."""
    machine = alike(2, jerk=JERK)
    points = circle(0.02, 1e-4, 7.5)
    planner = MotionPlanner(machine, np.zeros(2))
    moves = [Move(group, tolerance=1e-4) for group in polyline(machine, points.tolist(), 0.1)]
    pieces: list[Piece] = []
    for number, move in enumerate(moves, start=1):
        planner.append(planner.segment(move.group, number), tolerance=move.tolerance)
        if planner.full:
            pieces += planner.commit() or ()
    pieces += planner.close()
    motion = collect(machine, moves, np.zeros(2), pieces)
    assert_kept(motion, 1e-4)
    assert sorted(motion.starts) == sorted(motion.ends) == list(range(1, len(points)))
    assert (motion.position[-1] == points[-1]).all()
    arc = plan(machine, [at_speed(0.1, arc_curve((0.0, 0.0), (0.0, 0.02), 7.5))])
    # each commit keeps a distance from what may still change of the curve: some per cent of the time
    assert motion.duration <= 1.05 * arc.duration
