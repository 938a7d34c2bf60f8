"""The corner of two straight segments, rounded: shape, distance from the corner, and how long it takes.

The blend is a quintic Bezier curve whose ends continue the lines with no bend (see
`mcserver.motion.geometry.blend`). With the vertex at 0 it scales with its reach d, the distance from the
vertex at which it leaves and joins: so does its distance from the lines, and one shape for d = 1 tells
everything.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.junctions import length_of, line_sample, meet
from mcserver.motion.kernels.knots import SOLVED, find_keys
from mcserver.motion.kernels.parts import is_long, near_vertex, straight_limits
from mcserver.motion.kernels.polynomials import PLACES, half_of, limit_of, polynomial_samples, power_basis
from mcserver.motion.kernels.ramp_kernels import reachable_speed
from mcserver.motion.kernels.sample_limits import bind_joints, ease_short, run_of

# What the polyline through these places may miss of the curve, as a share of the distance.
_POLYLINE = 1.001

# At a corner that is a stop, a blend is chosen that takes less than this share of the time. At one that can
# be passed at a speed, one that can be passed so much faster, since near its top speed a bend leaves hardly
# anything to get there; it may lose a little where the motion is slow on both sides.
BETTER = 1.0 - 1e-6
FASTER = 1.2
LOSS = 0.05


class Corner(NamedTuple):
    """Two straight segments on end.

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
    """Writes the coefficients (6, K), constant first, of the blend with d = 1 about a vertex at 0.

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
    """Squared distance of a point from a straight segment."""
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
def farthest(points: Array, polyline: Array) -> float:
    """Largest distance of points (n, K) from a polyline (m, K)."""
    worst = 0.0
    for i in range(len(points)):
        near = math.inf
        for j in range(len(polyline) - 1):
            near = min(near, _to_segment(points[i], polyline[j], polyline[j + 1]))
        worst = max(worst, near)
    return math.sqrt(worst)


@compiled
def distance_from_corner(t1: Array, t2: Array, power: Array, weights: Array) -> float:
    """Largest distance between blend and lines for d = 1, in either direction.

    Args:
        weights: of each column in that distance, shape (K,).
    """
    width = len(t1)
    blend = np.empty((PLACES, width))
    lines = np.zeros((PLACES, width))
    half = PLACES // 2
    for i in range(PLACES):
        s, share = i / (PLACES - 1), (i - half) / half
        for k in range(width):
            value = power[5, k]
            for row in range(4, -1, -1):
                value = value * s + power[row, k]
            blend[i, k] = value * weights[k]
            lines[i, k] = (share * t1[k] if share < 0.0 else share * t2[k]) * weights[k]
    corner = lines[::half]
    return max(farthest(blend, corner), farthest(lines, blend)) * _POLYLINE


@compiled
def run_time(
    rows: Array,
    offset: NDArray[np.intp],
    edges: Array,
    caps: Array,
    tops: Array,
    corner: Corner,
    entry: float,
) -> float:
    """How long a short run of segments takes from the speed ``entry`` to rest [s]; infinite: no time law.

    Args:
        rows, offset: samples of n segments. edges, caps: shape (n+1,). tops: shape (n,).
    """
    n = len(tops)
    caps[0], caps[n] = entry, 0.0
    ease_short(edges, caps, tops, corner.cycle)
    run = run_of(rows, offset, tops, corner.limits, corner.cycle)
    bind_joints(caps, tops)
    caps[0] = min(entry, tops[0])
    is_key = caps <= 0.0
    is_key[0] = is_key[n] = True
    # a literal would have the search compiled once more, for that value alone
    plain = bool(np.bool_(False))
    status, _, _, _, phases, _ = find_keys(run, edges, caps, np.zeros(n, np.bool_), is_key, caps[0], plain)
    return phases[:, 0].sum() if status == SOLVED else math.inf


@compiled
def corner_time(corner: Corner, left: float, right: float, entry: float) -> tuple[float, float]:
    """How long they take where the corner stays, and how fast it can be passed.

    Args:
        left, right: what is left of them [m]. entry: speed at the beginning.
    """
    last, first, limits = corner.last, corner.first, corner.limits
    width = len(last)
    still = np.zeros(width)
    lines, samples = np.zeros((2, 5 * width + 2)), np.zeros((2, 5 * width + 2))
    end, begin = length_of(last), length_of(first)
    speed, _ = meet(last, still, end, first, still, limits, corner.cycle, True, samples)
    tops = np.empty(2)
    tops[0], _ = line_sample(last, end, limits, lines[:1])
    tops[1], _ = line_sample(first, begin, limits, lines[1:])
    tops = np.minimum(tops, corner.feeds)
    # the same parts as in a run: see `mcserver.motion.kernels.groups`
    rows, offset = np.empty((6, 5 * width + 2)), np.zeros(5, np.intp)
    edges, caps, parts_tops = np.zeros(5), np.full(5, math.inf), np.empty(4)
    part = at = 0
    for side in range(2):
        length, reach = (left, right)[side], 0.0
        # where no vertex is passed with a bounded speed there is nothing that it asks for
        asks = 0.0 < speed < math.inf
        if asks:
            passed = min(speed, tops[side])
            acceleration, _ = straight_limits(lines[side], limits)
            reach = near_vertex(passed, acceleration, corner.cycle)
            if not is_long(length, reach, reach, acceleration, passed):
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
                edges[part + 1], parts_tops[part] = edges[part] + span, tops[side]
                part += 1
                offset[part] = at
        if side == 0:
            caps[part] = speed
    ends = part + 1
    time = run_time(rows[:at], offset[:ends], edges[:ends], caps[:ends], parts_tops[:part], corner, entry)
    return time, speed


@compiled
def blend_time(corner: Corner, left: float, right: float, entry: float, power: Array) -> tuple[float, float]:
    """How long they take with a blend, and how fast that can be passed.

    Args:
        left, right: what is left of them beside the blend [m]. power: of the blend.
    """
    last, first, limits, feeds = corner.last, corner.first, corner.limits, corner.feeds
    width = len(last)
    rows = np.zeros((2 + 2 * PLACES, 5 * width + 2))
    tops = np.empty(4)
    limit, _ = line_sample(last, length_of(last), limits, rows[:1])
    tops[0] = min(limit, feeds[0])
    limit, _ = line_sample(first, length_of(first), limits, rows[1 + 2 * PLACES :])
    tops[3] = min(limit, feeds[1])
    part = np.empty((6, width))
    speeds = np.empty(PLACES)
    half_of(power, 0.0, 0.5, part)
    # along σ, which goes on where the halves meet
    scale = length_of(part[1])
    for half in range(2):
        half_of(power, 0.5 * half, 0.5, part)
        where = slice(1 + half * PLACES, 1 + (half + 1) * PLACES)
        polynomial_samples(part, scale, rows[where], speeds)
        limit, _, _ = limit_of(rows[where], limits)
        tops[1 + half] = min(limit, feeds[half] * scale / speeds.max())
    edges = np.cumsum(np.array([0.0, left, scale, scale, right]))
    caps = np.full(5, math.inf)
    offset = np.array([0, 1, 1 + PLACES, 1 + 2 * PLACES, 2 + 2 * PLACES])
    top = min(tops[1], tops[2])
    return run_time(rows, offset, edges, caps, tops, corner, entry), top


@compiled
def entry_speed(corner: Corner) -> float:
    """Half of the speed that the first segment could have reached from rest in its own length."""
    length = length_of(corner.last)
    line = np.zeros((1, 5 * len(corner.last) + 2))
    top, _ = line_sample(corner.last, length, corner.limits, line)
    acceleration, jerk = straight_limits(line[0], corner.limits)
    return 0.5 * reachable_speed(0.0, length, acceleration, jerk, min(top, corner.feeds[0]))


@compiled
def may_win(speed: float, from_rest: float, slow: float, top: float, fastest: float) -> bool:
    """Whether a blend is worth having in place of a corner.

    At a stop it has to win from rest to rest: what is quicker at speed may be slower between two stops.

    Args:
        speed: at which the corner can be passed. from_rest, slow: times of corner and blend from rest to rest
            [s]. top: greatest speed on the blend. fastest: what that has to pass where the corner is no stop.
    """
    if speed > 0.0:
        return top > fastest and slow <= from_rest * (1.0 + LOSS)
    return slow < from_rest * BETTER


@compiled
def best_reach(corner: Corner, left: float, right: float, power: Array, reaches: Array, gain: float) -> float:
    """The reach with which the corner is passed soonest; 0: it stays.

    Args:
        left, right: what is left of the segments [m]. power: of the shape with d = 1. reaches: what is tried,
            shape (n,). gain: what a corner that is a stop takes less than the lines to it and from it [s].
    """
    entry = entry_speed(corner)
    from_rest, speed = corner_time(corner, left, right, 0.0)
    least = math.inf
    if speed <= 0.0:
        least, _ = corner_time(corner, left, right, entry)
        # not from rest: in a chain of short lines a blend keeps a speed that such a judgement does not see
        least -= gain
    best, fastest = 0.0, FASTER * speed
    for reach in reaches:
        if not reach > 0.0:
            continue
        there = power * reach
        slow, top = blend_time(corner, left - reach, right - reach, 0.0, there)
        if not may_win(speed, from_rest, slow, top, fastest):
            continue
        if speed > 0.0:
            best, fastest = reach, top
            continue
        time, _ = blend_time(corner, left - reach, right - reach, entry, there)
        if time < least * BETTER:
            best, least = reach, time
    return best
