"""Time-domain blends of corners: quicker than a stop, within tolerance and limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.segment import AxisLimits, anchor, segment_of
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.time_domain_corner import is_time_domain
from tests.motion.measure import VELOCITY_SLACK, assert_kept, farthest_from_path, speed_over_feed
from tests.motion.support import (
    AxisSpec,
    Commit,
    Motion,
    Move,
    alike,
    arc_curve,
    at_speed,
    edges_of,
    in_time,
    line_curve,
    machine_of,
    plan,
    polyline,
)

SIDE, SPEED = 0.05, 0.1


def polygon(machine: Machine, corners: int, heading: float) -> list[FeedGroup]:
    """Once round, from a corner in the direction ``heading`` [rad]."""
    places = [(0.0, 0.0)]
    for index in range(corners):
        angle = heading + 2.0 * math.pi * index / corners
        x, y = places[-1]
        places.append((x + SIDE * math.cos(angle), y + SIDE * math.sin(angle)))
    return polyline(machine, places, SPEED)


def both(machine: Machine, lines: Sequence[FeedGroup], tolerance: float) -> tuple[Motion, Motion]:
    """With a stop at every corner, and with this tolerance [m]."""
    stopping = plan(machine, [Move(group, from_rest=True) for group in lines])
    return stopping, plan(machine, [Move(group, tolerance=tolerance) for group in lines])


@pytest.mark.parametrize("corners", [3, 4, 6])
@pytest.mark.parametrize("heading", [0.0, 0.2])
@pytest.mark.parametrize("jerk", [None, 20_000.0, 50_000.0])
@pytest.mark.parametrize("tolerance", [1e-5, 1e-4, 1e-3])
def test_a_polygon_is_quicker_than_with_stops(
    corners: int, heading: float, jerk: float | None, tolerance: float
) -> None:
    machine = alike(2, jerk=jerk)
    stopping, rounded = both(machine, polygon(machine, corners, heading), tolerance)
    assert rounded.duration < stopping.duration - rounded.cycle
    assert_kept(rounded, tolerance)


@pytest.mark.parametrize(("jerk", "gain"), [(None, 0.023), (50_000.0, 0.037), (20_000.0, 0.053)])
def test_ramps_of_different_axes_overlap(jerk: float | None, gain: float) -> None:
    """Ramps that overlap by τ miss a right angle by √2 a τ²/8, or √2 j τ³/48 if only jerk bounds them there.

    0.1 mm are 23.8 ms, or 40.8 and 55.4 ms, of which the first is longer than 2 a/j = 40 ms.
    """
    machine = alike(2, jerk=jerk)
    lines = polyline(machine, [(0.0, 0.0), (SIDE, 0.0), (SIDE, SIDE)], SPEED)
    stopping, rounded = both(machine, lines, 1e-4)
    assert stopping.duration - rounded.duration >= gain
    assert_kept(rounded, 1e-4)


@pytest.mark.parametrize("jerk", [None, 50_000.0])
def test_lines_that_name_one_axis_each(jerk: float | None) -> None:
    """The axis of the second line is driven before that line has begun."""
    machine = alike(3, jerk=jerk)
    first = at_speed(SPEED, line_curve(machine, (0,), (0.0,), (SIDE,)))
    second = at_speed(SPEED, line_curve(machine, (1,), (0.0,), (SIDE,)))
    stopping, rounded = both(machine, [first, second], 1e-4)
    assert rounded.duration < stopping.duration - 10.0 * rounded.cycle
    assert_kept(rounded, 1e-4)
    assert rounded.position[-1] == pytest.approx([SIDE, SIDE, 0.0], abs=1e-12)


@pytest.mark.parametrize("jerk", [None, 20_000.0])
def test_axes_of_unlike_limits_and_a_rotary_one(jerk: float | None) -> None:
    machine = machine_of(
        [AxisSpec(200.0, 1000.0, jerk), AxisSpec(80.0, 300.0, jerk), AxisSpec(90.0, 700.0, jerk, rotary=True)]
    )
    moves = [
        at_speed(SPEED, line_curve(machine, (0, 1), (0.0, 0.0), (0.03, 0.01))),
        at_speed(SPEED, line_curve(machine, (0, 1), (0.03, 0.01), (0.02, 0.04))),
        at_speed(0.5, line_curve(machine, (2,), (0.0,), (1.0,))),
        at_speed(SPEED, line_curve(machine, (0,), (0.02,), (-0.02,))),
    ]
    stopping, rounded = both(machine, moves, 2e-4)
    assert rounded.duration < stopping.duration - 10.0 * rounded.cycle
    assert_kept(rounded, 2e-4)


@pytest.mark.parametrize("sweep", [-math.pi / 2.0, math.pi])
def test_a_line_and_an_arc(sweep: float) -> None:
    machine = alike(2, jerk=20_000.0)
    line = at_speed(SPEED, line_curve(machine, (0, 1), (0.0, 0.0), (0.04, 0.0)))
    arc = at_speed(SPEED, arc_curve((0.04, 0.0), (0.04 + math.copysign(0.02, sweep), 0.0), sweep))
    stopping, rounded = both(machine, [line, arc], 1e-4)
    assert rounded.duration < stopping.duration - 10.0 * rounded.cycle
    assert_kept(rounded, 1e-4)


def test_a_line_with_a_time_of_its_own_keeps_it() -> None:
    machine = alike(2, jerk=20_000.0)
    lines = [
        at_speed(SPEED, line_curve(machine, (0,), (0.0,), (SIDE,))),
        in_time(1.0, line_curve(machine, (1,), (0.0,), (SIDE,))),
    ]
    motion = plan(machine, [Move(group, tolerance=1e-3) for group in lines])
    assert motion.took(2) == pytest.approx(1.0, abs=1e-9)
    assert farthest_from_path(motion) <= 1e-3


@pytest.mark.parametrize("jerk", [None, 20_000.0])
def test_a_slower_line_begins_at_its_own_feed(jerk: float | None) -> None:
    machine = alike(2, jerk=jerk)
    for before, after in ((0.1, 0.01), (0.01, 0.1)):
        lines = [
            at_speed(before, line_curve(machine, (0, 1), (0.0, 0.0), (0.005, 0.0))),
            at_speed(after, line_curve(machine, (0, 1), (0.005, 0.0), (0.003, 0.004))),
        ]
        stopping, rounded = both(machine, lines, 1e-3)
        assert rounded.duration <= stopping.duration + rounded.cycle
        assert speed_over_feed(rounded) <= VELOCITY_SLACK


@pytest.mark.parametrize("jerk", [None, 20_000.0])
def test_feed_holds_for_what_it_counts_where_other_axes_move_too(jerk: float | None) -> None:
    """G94 counts the linear axes of the first command; what is turned beside it gives it no room."""
    machine = machine_of([AxisSpec(200.0, 1000.0, jerk)] * 2 + [AxisSpec(500.0, 5000.0, jerk, rotary=True)])
    slow = at_speed(
        0.001,
        line_curve(machine, (0,), (0.0,), (0.001,)),
        line_curve(machine, (2,), (0.0,), (1.5,)),
    )
    fast = at_speed(0.1, line_curve(machine, (0, 1), (0.001, 0.0), (0.03, 0.01)))
    _, rounded = both(machine, [slow, fast], 1e-3)
    assert speed_over_feed(rounded) <= VELOCITY_SLACK


def test_lines_begin_and_end_once_however_their_window_is_cut() -> None:
    """A cut that is one with the end of a line but for rounding is taken for that end by all."""
    machine = alike(3, cycle_hz=250.0)
    random = np.random.default_rng(1)
    for _ in range(150):
        steps = random.uniform(-1.0, 1.0, (3, 3)) * [2e-3, 2e-3, 1e-3]
        places = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        feeds = random.uniform(0.005, 0.05, 3)
        lines = [
            at_speed(float(feeds[i]), line_curve(machine, (0, 1, 2), places[i], places[i + 1]))
            for i in range(3)
        ]
        commits = [Commit(3, float(random.uniform(1.0, 40.0)))]
        for tolerance in (0.0, 5e-5):
            motion = plan(machine, [Move(each, tolerance=tolerance) for each in lines], commits=commits)
            marks = [(line, ends) for _, line, ends in edges_of(motion.pieces)]
            assert sorted(marks) == [(line, ends) for line in (1, 2, 3) for ends in (False, True)]


def test_an_exact_stop_stays_one() -> None:
    machine = alike(2, jerk=20_000.0)
    lines = polyline(machine, [(0.0, 0.0), (SIDE, 0.0), (SIDE, SIDE)], SPEED)
    motion = plan(machine, [Move(lines[0], tolerance=1e-3), Move(lines[1], from_rest=True, tolerance=1e-3)])
    assert farthest_from_path(motion) <= 1e-9


def test_no_axis_passes_the_corner_of_its_travel() -> None:
    machine = alike(2, jerk=20_000.0)
    motion = plan(machine, [Move(group, tolerance=1e-3) for group in polygon(machine, 4, 0.0)])
    assert motion.position.min() >= -1e-9
    assert motion.position.max() <= SIDE + 1e-9


@pytest.mark.parametrize("ahead", [1.0, 7.0, 60.0, 400.0])
@pytest.mark.parametrize("jerk", [None, 50_000.0])
def test_a_window_may_be_cut_anywhere_between_its_corners(ahead: float, jerk: float | None) -> None:
    machine = alike(2, jerk=jerk)
    places = [(0.004 * ((i + 1) // 2), 0.004 * (i // 2)) for i in range(24)]
    moves = [Move(group, tolerance=1e-4) for group in polyline(machine, places, SPEED)]
    whole = plan(machine, moves)
    cut = plan(machine, moves, commits=[Commit(after, ahead) for after in range(1, 24)])
    assert_kept(cut, 1e-4)
    assert cut.position[-1] == pytest.approx(whole.position[-1], abs=1e-12)
    assert cut.duration >= whole.duration - 2.0 * cut.cycle
    assert whole.duration < plan(machine, [Move(each.group) for each in moves]).duration


def planned(jerk: float, tolerance: float) -> PlannedRun:
    machine = alike(2, jerk=jerk)
    window, position = Lookahead(AxisLimits.of(machine)), np.zeros(2)
    for number, group in enumerate(polyline(machine, [(0, 0), (SIDE, 0), (SIDE, SIDE)], SPEED), start=1):
        segment = segment_of(group, number, {0: 0, 1: 1}, np.ones(2, np.bool_))
        anchor(segment, position)
        segment.tolerance = tolerance
        window.append(segment)
    return window.plan()


def test_outside_of_its_corners_a_run_is_as_it_was() -> None:
    exact, rounded = planned(20_000.0, 0.0), planned(20_000.0, 1e-4)
    assert [is_time_domain(each) for each in rounded.segments] == [False, True, True, False]
    assert rounded.window_index.tolist() == [0, 0, 1, 1]
    assert rounded.window == exact.window == 2
    leave, middle, join = rounded.times[1:4].tolist()
    saved = exact.phases.duration - rounded.phases.duration
    # by symmetry
    assert middle == pytest.approx(0.5 * (leave + join))
    before = np.linspace(0.0, leave, 20)[:-1]
    after = np.linspace(join, rounded.phases.duration, 20)
    for run_time, law_time in ((before, before), (after, after + saved)):
        for found, expected in zip(rounded.phases.at(run_time), exact.phases.at(law_time), strict=True):
            assert found == pytest.approx(expected, abs=1e-9)


def test_what_is_left_after_a_moment_counts_from_there() -> None:
    run = planned(20_000.0, 1e-4)
    moment = 0.5 * float(run.times[1])
    rest = run.after(moment)
    assert rest.phases.duration == pytest.approx(run.phases.duration - moment)
    assert rest.times[1:] == pytest.approx(run.times[1:] - moment)
    assert not rest.segments[0].opens
    # at the very start of a corner the line before it is what is left, with nothing of it
    rest = run.after(float(run.times[1]))
    assert rest.window_index.tolist() == [0, 0, 1, 1]
    assert rest.times[:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    # at its end the second line
    rest = run.after(float(run.times[3]))
    assert rest.window_index.tolist() == [0]
    assert rest.segments[0].begin == pytest.approx(run.segments[3].begin)
