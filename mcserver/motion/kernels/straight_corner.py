"""The blend of two straight segments: shape, distance from the corner, and time.

The blend is a quintic Bezier curve whose ends continue the lines without curvature (see
`mcserver.motion.geometry.blend`). With the vertex at 0 the curve and its distance from the lines scale with
d, the distance from the vertex at which it leaves and joins: one shape for d = 1 suffices.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import POLYNOMIAL_SAMPLES, Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.junctions import PrecedingEnd, junction_vmax_of, length_of, line_sample
from mcserver.motion.kernels.knots import SOLVED, find_knots
from mcserver.motion.kernels.parts import is_split, straight_limits, vertex_zone_length
from mcserver.motion.kernels.polynomials import (
    limit_of,
    polynomial_samples,
    power_basis,
    restrict_polynomial,
)
from mcserver.motion.kernels.ramp_kernels import reachable_speed
from mcserver.motion.kernels.sample_limits import limit_junctions, limit_short_segments, run_of

# Margin for the distance between samples of the curve.
_POLYLINE = 1.001

# A blend replaces a stop if it takes less than this share of the time.
BETTER = 1.0 - 1e-6
# It replaces a corner that is passed at a speed if it can be passed this much faster: near its top speed,
# curvature leaves hardly any acceleration to reach it.
FASTER = 1.2
# Share of the time that it may lose then, where the motion is slow on both sides.
LOSS = 0.05


class Corner(NamedTuple):
    """Two consecutive straight segments.

    Attributes:
        last, first: travels of the two whole segments, shape (K,). feeds: greatest path speeds of the two by
            their F, shape (2,). limits, cycle: of the axes, shape (3, K), and [s].
    """

    last: Array
    first: Array
    feeds: Array
    limits: Array
    cycle: float


@compiled
def quintic(t1: Array, t2: Array, handle: float, power: Array) -> None:
    """Write the coefficients (6, K), constant first, of the blend with d = 1 about a vertex at 0.

    Args:
        t1, t2: unit tangents before and after, shape (K,). handle: length of the Bezier handles.
    """
    points = np.empty((6, len(t1)))
    points[0], points[5] = -t1, t2
    points[1], points[4] = points[0] + handle * t1, points[5] - handle * t2
    points[2], points[3] = 2.0 * points[1] - points[0], 2.0 * points[4] - points[5]
    power_basis(points, power)


@compiled
def _to_segment(point: Array, start: Array, end: Array) -> float:
    """Return the squared distance of a point from a straight segment."""
    along = length = 0.0
    for k in range(len(point)):
        travel = end[k] - start[k]
        along += (point[k] - start[k]) * travel
        length += travel * travel
    share = min(max(along / max(length, 1e-300), 0.0), 1.0)
    away = 0.0
    for k in range(len(point)):
        gap = point[k] - start[k] - share * (end[k] - start[k])
        away += gap * gap
    return away


@compiled
def max_distance_to_polyline(points: Array, polyline: Array) -> float:
    """Return the largest distance of points (n, K) from a polyline (m, K)."""
    worst = 0.0
    for i in range(len(points)):
        near = math.inf
        for j in range(len(polyline) - 1):
            near = min(near, _to_segment(points[i], polyline[j], polyline[j + 1]))
        worst = max(worst, near)
    return math.sqrt(worst)


@compiled
def distance_from_corner(t1: Array, t2: Array, power: Array, weights: Array) -> float:
    """Return the largest distance between blend and lines for d = 1, in either direction.

    Args:
        weights: of each column in that distance, shape (K,).
    """
    width = len(t1)
    blend = np.empty((POLYNOMIAL_SAMPLES, width))
    lines = np.zeros((POLYNOMIAL_SAMPLES, width))
    half = POLYNOMIAL_SAMPLES // 2
    for i in range(POLYNOMIAL_SAMPLES):
        s, share = i / (POLYNOMIAL_SAMPLES - 1), (i - half) / half
        for k in range(width):
            value = power[5, k]
            for row in range(4, -1, -1):
                value = value * s + power[row, k]
            blend[i, k] = value * weights[k]
            lines[i, k] = (share * t1[k] if share < 0.0 else share * t2[k]) * weights[k]
    corner = lines[::half]
    return max(max_distance_to_polyline(blend, corner), max_distance_to_polyline(lines, blend)) * _POLYLINE


@compiled
def run_time(
    rows: Array,
    offset: NDArray[np.intp],
    edges: Array,
    junction_vmax: Array,
    segment_vmax: Array,
    corner: Corner,
    entry: float,
) -> float:
    """Return the time of a short run of segments from the speed ``entry`` to rest [s]; infinite without a
    velocity profile.

    Args:
        rows, offset: samples of n segments. edges, junction_vmax: shape (n+1,). segment_vmax: shape (n,).
    """
    n = len(segment_vmax)
    junction_vmax[0], junction_vmax[n] = entry, 0.0
    limit_short_segments(edges, junction_vmax, segment_vmax, corner.cycle)
    run = run_of(rows, offset, segment_vmax, corner.limits, corner.cycle)
    limit_junctions(junction_vmax, segment_vmax)
    junction_vmax[0] = min(entry, segment_vmax[0])
    is_key = junction_vmax <= 0.0
    is_key[0] = is_key[n] = True
    # a literal would make numba compile the search again for that value
    plain = bool(np.bool_(False))
    status, _, _, _, phases, _, _ = find_knots(
        run, edges, junction_vmax, np.full(n, math.nan), is_key, junction_vmax[0], plain
    )
    return phases[:, 0].sum() if status == SOLVED else math.inf


@compiled
def corner_time(corner: Corner, left: float, right: float, entry: float) -> tuple[float, float]:
    """Return the time of the two segments with the corner as it is [s], and the greatest speed over it.

    Args:
        left, right: their remaining lengths [m]. entry: speed at the beginning.
    """
    last, first, limits = corner.last, corner.first, corner.limits
    width = len(last)
    still = np.zeros(width)
    lines, samples = np.zeros((2, 5 * width + 2)), np.zeros((2, 5 * width + 2))
    end, begin = length_of(last), length_of(first)
    speed, _ = junction_vmax_of(
        PrecedingEnd(last, still, end, True), first, still, limits, corner.cycle, True, True, samples
    )
    segment_vmax = np.empty(2)
    segment_vmax[0], _ = line_sample(last, end, limits, lines[:1])
    segment_vmax[1], _ = line_sample(first, begin, limits, lines[1:])
    segment_vmax = np.minimum(segment_vmax, corner.feeds)
    # the same parts as in a run: see `mcserver.motion.kernels.groups`
    rows, offset = np.empty((6, 5 * width + 2)), np.zeros(5, np.intp)
    edges, junction_vmax, part_vmax = np.zeros(5), np.full(5, math.inf), np.empty(4)
    part = at = 0
    for side in range(2):
        length, reach = (left, right)[side], 0.0
        # only a vertex with a finite speed above 0 has samples
        asks = 0.0 < speed < math.inf
        if asks:
            passed = min(speed, segment_vmax[side])
            acceleration, _ = straight_limits(lines[side], limits)
            reach = vertex_zone_length(passed, acceleration, corner.cycle)
            if not is_split(length, reach, reach, acceleration, passed):
                reach = length
        for place in range(2):
            near = place != side
            span = reach if near else length - reach
            if span > 0.0:
                rows[at] = lines[side]
                at += 1
                if near:
                    rows[at] = samples[side]
                    at += 1
                edges[part + 1], part_vmax[part] = edges[part] + span, segment_vmax[side]
                part += 1
                offset[part] = at
        if side == 0:
            junction_vmax[part] = speed
    ends = part + 1
    time = run_time(
        rows[:at], offset[:ends], edges[:ends], junction_vmax[:ends], part_vmax[:part], corner, entry
    )
    return time, speed


@compiled
def blend_time(corner: Corner, left: float, right: float, entry: float, power: Array) -> tuple[float, float]:
    """Return the time of the two segments with a blend [s], and the greatest speed on it.

    Args:
        left, right: their lengths outside of the blend [m]. power: of the blend.
    """
    last, first, limits, feeds = corner.last, corner.first, corner.limits, corner.feeds
    width = len(last)
    rows = np.zeros((2 + 2 * POLYNOMIAL_SAMPLES, 5 * width + 2))
    segment_vmax = np.empty(4)
    limit, _ = line_sample(last, length_of(last), limits, rows[:1])
    segment_vmax[0] = min(limit, feeds[0])
    limit, _ = line_sample(first, length_of(first), limits, rows[1 + 2 * POLYNOMIAL_SAMPLES :])
    segment_vmax[3] = min(limit, feeds[1])
    part = np.empty((6, width))
    speeds = np.empty(POLYNOMIAL_SAMPLES)
    restrict_polynomial(power, 0.0, 0.5, part)
    # σ is continuous where the halves meet
    scale = length_of(part[1])
    for half in range(2):
        restrict_polynomial(power, 0.5 * half, 0.5, part)
        where = slice(1 + half * POLYNOMIAL_SAMPLES, 1 + (half + 1) * POLYNOMIAL_SAMPLES)
        polynomial_samples(part, scale, rows[where], speeds)
        limit, _, _ = limit_of(rows[where], limits)
        segment_vmax[1 + half] = min(limit, feeds[half] * scale / speeds.max())
    edges = np.cumsum(np.array([0.0, left, scale, scale, right]))
    junction_vmax = np.full(5, math.inf)
    offset = np.array([0, 1, 1 + POLYNOMIAL_SAMPLES, 1 + 2 * POLYNOMIAL_SAMPLES, 2 + 2 * POLYNOMIAL_SAMPLES])
    top = min(segment_vmax[1], segment_vmax[2])
    return run_time(rows, offset, edges, junction_vmax, segment_vmax, corner, entry), top


@compiled
def entry_speed(corner: Corner) -> float:
    """Return half of the speed that the first segment could have reached from rest in its own length."""
    length = length_of(corner.last)
    line = np.zeros((1, 5 * len(corner.last) + 2))
    top, _ = line_sample(corner.last, length, corner.limits, line)
    acceleration, jerk = straight_limits(line[0], corner.limits)
    return 0.5 * reachable_speed(0.0, length, acceleration, jerk, min(top, corner.feeds[0]))


@compiled
def is_worthwhile(speed: float, from_rest: float, slow: float, top: float, fastest: float) -> bool:
    """Return whether a blend is worth replacing a corner.

    At a stop it has to be faster from rest to rest too: one that is faster at speed may be slower between two
    stops.

    Args:
        speed: at which the corner can be passed. from_rest, slow: times of corner and blend from rest to rest
            [s]. top: greatest speed on the blend. fastest: speed that ``top`` has to exceed where the corner
            is no stop.
    """
    if speed > 0.0:
        return top > fastest and slow <= from_rest * (1.0 + LOSS)
    return slow < from_rest * BETTER


@compiled
def best_blend_distance(
    corner: Corner, left: float, right: float, power: Array, blend_distances: Array, gain: float
) -> float:
    """Return the blend distance with the least time; 0 where the corner stays.

    Args:
        left, right: remaining lengths of the segments [m]. power: of the shape with d = 1.
        blend_distances: to try, shape (n,). gain: time that a time-domain blend would save if the corner is a
            stop [s].
    """
    entry = entry_speed(corner)
    from_rest, speed = corner_time(corner, left, right, 0.0)
    least = math.inf
    if speed <= 0.0:
        least, _ = corner_time(corner, left, right, entry)
        # compared at speed, not from rest: in a chain of short lines a blend keeps speed
        least -= gain
    best, fastest = 0.0, FASTER * speed
    for reach in blend_distances:
        if not reach > 0.0:
            continue
        there = power * reach
        slow, top = blend_time(corner, left - reach, right - reach, 0.0, there)
        if not is_worthwhile(speed, from_rest, slow, top, fastest):
            continue
        if speed > 0.0:
            best, fastest = reach, top
            continue
        time, _ = blend_time(corner, left - reach, right - reach, entry, there)
        if time < least * BETTER:
            best, least = reach, time
    return best
