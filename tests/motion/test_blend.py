"""Rounded corners: within the tolerance measured independently, continuous in tangent and curvature."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.motion.geometry.blend import Blend, blend
from mcserver.motion.geometry.curves import Array, Curve
from mcserver.motion.geometry.segment import Segment, anchor, segment_of
from tests.motion.measure import (
    acceleration_ratio,
    farthest_from_path,
    jerk_ratio,
    path_missed_by,
    velocity_ratio,
)
from tests.motion.support import Move, alike, arc_curve, at_speed, line_curve, plan, polyline
from tests.motion.test_laws import law

WIDTH = 3
TOLERANCES = st.sampled_from([1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
LENGTHS = st.sampled_from([1e-4, 1e-3, 0.01, 0.2])
ANGLES = st.sampled_from([0.01, 0.1, 0.5, 1.0, math.pi / 2, 2.0, 2.6])


def segment(curve: Curve, line: int, base: Array, feed: float = 0.1) -> Segment:
    made = segment_of(
        at_speed(feed, curve), line, {axis: axis for axis in range(WIDTH)}, np.ones(WIDTH, np.bool_)
    )
    anchor(made, base.copy())
    made.active = made.mask
    return made


@st.composite
def corners(draw: st.DrawFn) -> tuple[Segment, Segment]:
    """A line or arc that ends at the origin of the plane and a line or arc that leaves it at an angle."""
    machine = alike(WIDTH)
    base = np.zeros(WIDTH)
    angle = draw(ANGLES)
    length = draw(LENGTHS)
    if draw(st.booleans()):
        first: Curve = line_curve(machine, (0, 1, 2), (-length, 0.0, 0.1 * length), (0.0, 0.0, 0.0))
        base = np.array([-length, 0.0, 0.1 * length])
    else:
        first = arc_curve((-length, length), (0.0, length), math.pi / 2)
        base = np.array([-length, length, 0.0])
    length = draw(LENGTHS)
    direction = (math.cos(angle), math.sin(angle))
    if draw(st.booleans()):
        second: Curve = line_curve(
            machine, (0, 1), (0.0, 0.0), (length * direction[0], length * direction[1])
        )
    else:
        second = arc_curve((0.0, 0.0), (-length * direction[1], length * direction[0]), 1.0)
    return segment(first, 1, base), segment(second, 2, np.zeros(WIDTH))


def dense_path(parts: list[Segment], count: int = 200) -> Array:
    return np.concatenate([part.sample(np.linspace(part.begin, part.finish, count))[0] for part in parts])


def max_distance_to_polyline(points: Array, path: Array) -> float:
    """Largest distance of points from the nearest of densely sampled ones, less half their spacing."""
    gap = np.sqrt(((points[:, None, :] - path[None, :, :]) ** 2).sum(axis=2))
    return float(gap.min(axis=1).max())


def made_of(before: Segment, after: Segment, tolerance: float) -> Blend | None:
    return blend(before, after, tolerance, np.ones(WIDTH))


@given(corners(), TOLERANCES)
@law(50)
def test_a_blend_is_within_the_tolerance_in_either_direction(
    corner: tuple[Segment, Segment], tolerance: float
) -> None:
    before, after = corner
    made = made_of(before, after, tolerance)
    assert made is not None
    rounded = dense_path([made.first, made.second])
    # the part of the programmed path that the blend replaces
    left = before.sample(np.linspace(made.before.finish, 1.0, 200))[0]
    right = after.sample(np.linspace(0.0, made.after.begin, 200))[0]
    programmed = np.concatenate([left, right])
    spacing = max(
        float(np.linalg.norm(np.diff(path, axis=0), axis=1).max()) for path in (rounded, left, right)
    )
    allowed = math.hypot(tolerance, spacing)
    assert max_distance_to_polyline(rounded, programmed) <= allowed
    assert max_distance_to_polyline(programmed, rounded) <= allowed


@given(corners(), TOLERANCES)
@law(50)
def test_position_tangent_and_curvature_go_on_through_every_joint_of_a_blend(
    corner: tuple[Segment, Segment], tolerance: float
) -> None:
    made = made_of(*corner, tolerance)
    assert made is not None
    parts = [made.before, made.first, made.second, made.after]
    size = tolerance + min(part.extent for part in parts)
    for left, right in itertools.pairwise(parts):
        end, begin = np.array([left.finish]), np.array([right.begin])
        assert left.sample(end)[0] == pytest.approx(right.sample(begin)[0], abs=1e-12)
        t1, k1 = tangent_and_curvature(left, end)
        t2, k2 = tangent_and_curvature(right, begin)
        assert t1 == pytest.approx(t2, abs=1e-6)
        assert k1 == pytest.approx(k2, abs=1e-5 / size)


def tangent_and_curvature(part: Segment, s: Array) -> tuple[Array, Array]:
    slope, bend, _ = (each[0] for each in part.derivatives(s, WIDTH))
    squared = slope @ slope
    tangent = slope / math.sqrt(squared)
    return tangent, (bend - tangent * (tangent @ bend)) / squared


@given(corners(), TOLERANCES)
@law(40)
def test_a_blend_leaves_each_line_half_of_itself(corner: tuple[Segment, Segment], tolerance: float) -> None:
    made = made_of(*corner, tolerance)
    assert made is not None
    assert made.before.finish >= 0.5
    assert made.after.begin <= 0.5


def test_a_move_straight_back_is_not_rounded() -> None:
    machine = alike(WIDTH)
    there = segment(line_curve(machine, (0,), (0.0,), (0.1,)), 1, np.zeros(WIDTH))
    back = segment(line_curve(machine, (0,), (0.1,), (0.0,)), 2, np.array([0.1, 0.0, 0.0]))
    assert made_of(there, back, 1e-3) is None


@pytest.mark.parametrize("jerk", [None, 20_000.0])
@pytest.mark.parametrize("tolerance", [1e-5, 1e-4, 1e-3])
def test_a_square_with_rounded_corners_is_quicker_than_one_with_stops_and_keeps_all_limits(
    tolerance: float, jerk: float | None
) -> None:
    machine = alike(2, velocity=200.0, acceleration=1000.0, jerk=jerk)
    square = polyline(machine, [(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1), (0, 0)], 0.1)
    stopping = plan(machine, [Move(group, from_rest=True) for group in square])
    rounded = plan(machine, [Move(group, tolerance=tolerance) for group in square])
    assert rounded.duration < stopping.duration
    assert farthest_from_path(rounded) <= tolerance
    assert path_missed_by(rounded) <= tolerance + 1.0 * rounded.cycle**2 / 8.0
    assert velocity_ratio(rounded) <= 1.001
    assert acceleration_ratio(rounded) <= 1.01
    if jerk is not None:
        assert jerk_ratio(rounded) <= 1.05


@given(
    st.lists(
        st.tuples(st.sampled_from([0.15, -0.5, 1.0, math.pi / 2, -math.pi / 2, 2.5]), st.floats(0.3, 1.0)),
        min_size=6,
        max_size=8,
    ),
    st.sampled_from([5e-3, 0.03, 0.1]),
    st.sampled_from([1e-5, 1e-4, 1e-3, 5e-3]),
    st.sampled_from([(200.0, 1000.0, None), (200.0, 10_000.0, 20_000.0), (1000.0, 10_000.0, 200_000.0)]),
    st.sampled_from([0.05, 0.2, 1.0]),
)
@law(60)
def test_no_tolerance_makes_a_program_slower(
    turns: list[tuple[float, float]],
    size: float,
    tolerance: float,
    limits: tuple[float, float, float | None],
    speed: float,
) -> None:
    velocity, acceleration, jerk = limits
    machine = alike(2, velocity=velocity, acceleration=acceleration, jerk=jerk)
    places, heading = [(0.0, 0.0)], 0.0
    for turn, share in turns:
        heading += turn
        x, y = places[-1]
        places.append((x + share * size * math.cos(heading), y + share * size * math.sin(heading)))
    lines = polyline(machine, places, speed)
    # exact vertices that are passed with speed keep no jerk limit: with one, stops are what remains
    exact = plan(machine, [Move(group, from_rest=jerk is not None) for group in lines])
    rounded = plan(machine, [Move(group, tolerance=tolerance) for group in lines])
    # a cycle: a run ends with the first whole one
    assert rounded.duration <= 1.0005 * exact.duration + rounded.cycle


@pytest.mark.parametrize("chord", [5e-4, 2e-3])
def test_a_polyline_that_stands_for_an_arc_is_passed_as_fast_as_the_arc(chord: float) -> None:
    machine = alike(2, velocity=200.0, acceleration=1000.0)
    radius, speed = 0.02, 0.1
    angles = np.arange(0.0, 5.0, chord / radius)
    places = [(radius * math.sin(angle), radius * (1.0 - math.cos(angle))) for angle in angles]
    motion = plan(machine, [Move(group, tolerance=1e-4) for group in polyline(machine, places, speed)])
    # at F, and once up and once down within the limits: 0.1 m/s at 1 m/s²
    ideal = radius * angles[-1] / speed + speed / 1.0
    assert motion.duration <= 1.08 * ideal
    assert farthest_from_path(motion) <= 1e-4
    assert acceleration_ratio(motion) <= 1.01


def test_a_bend_taken_at_speed_does_not_slow_down_the_way_to_it() -> None:
    # the first line took 66 ms in place of 36 where a third one followed
    machine = alike(2, velocity=200.0, acceleration=10_000.0)
    places = [(0.0, 0.0), (0.0044, 0.0), (0.00615, 0.00025), (0.0086, 0.0014)]
    lines = polyline(machine, places, 0.2)
    motion = plan(machine, [Move(group, tolerance=1e-5) for group in lines])
    assert motion.took(1) <= 0.040


def test_a_rounded_corner_belongs_half_to_each_line() -> None:
    machine = alike(2)
    corner = polyline(machine, [(0, 0), (0.1, 0), (0.1, 0.1)], 0.1)
    motion = plan(machine, [Move(group, tolerance=1e-3) for group in corner])
    middle = motion.ends[1]
    before, after = motion.position[math.floor(middle) - 1], motion.position[math.ceil(middle) - 1]
    assert motion.starts[2] == middle
    # the bisector of the corner: as far from X = 0.1 as from Y = 0
    assert 0.1 - before[0] >= before[1] - 1e-12
    assert 0.1 - after[0] <= after[1] + 1e-12
