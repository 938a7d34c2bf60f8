"""The corner of two straight segments, rounded: shape, distance from the corner, and how long it takes.

The blend is a quintic Bezier curve whose ends continue the lines with no bend (see `mcserver.motion.blend`).
With the vertex at 0 it scales with its reach d, the distance from the vertex at which it leaves and joins: so
does its distance from the lines, and one shape for d = 1 tells everything.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.joints import line_sample, meet
from mcserver.motion.kernels.keys import SOLVED, find_keys
from mcserver.motion.kernels.limits import GRID, GRID_SIZE, prepare
from mcserver.motion.kernels.polynomials import half_of, limit_of, polynomial_samples
from mcserver.motion.kernels.ramps import reachable_speed
from mcserver.motion.path import Array

# Places on a blend at which it is compared with the lines.
PLACES = 33
# What the polyline through these places may miss of the curve, as a share of the distance.
_POLYLINE = 1.001
# Cycles below which a segment's own top speed is that of its joints.
SHORT = 5.0


@compiled
def quintic(t1: Array, t2: Array, handle: float, power: Array) -> None:
    """Writes the coefficients (6, K), constant first, of the blend with d = 1 about a vertex at 0.

    Args:
        t1, t2: unit tangents before and after, shape (K,). handle: length of the Bezier handles.
    """
    for k in range(len(t1)):
        p0, p5 = -t1[k], t2[k]
        p1, p4 = p0 + handle * t1[k], p5 - handle * t2[k]
        p2, p3 = 2.0 * p1 - p0, 2.0 * p4 - p5
        power[0, k] = p0
        power[1, k] = 5.0 * (p1 - p0)
        power[2, k] = 10.0 * (p2 - 2.0 * p1 + p0)
        power[3, k] = 10.0 * (p3 - 3.0 * p2 + 3.0 * p1 - p0)
        power[4, k] = 5.0 * (p4 - 4.0 * p3 + 6.0 * p2 - 4.0 * p1 + p0)
        power[5, k] = p5 - 5.0 * p4 + 10.0 * p3 - 10.0 * p2 + 5.0 * p1 - p0


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
def distance_from_corner(t1: Array, t2: Array, power: Array, weights: Array) -> float:
    """Largest distance between blend and lines for d = 1, in either direction.

    Args:
        weights: of each column in that distance, shape (K,).
    """
    width = len(t1)
    blend = np.empty((PLACES, width))
    for i in range(PLACES):
        s = i / (PLACES - 1)
        for k in range(width):
            value = power[5, k]
            for row in range(4, -1, -1):
                value = value * s + power[row, k]
            blend[i, k] = value * weights[k]
    corner = np.zeros((3, width))
    for k in range(width):
        corner[0, k], corner[2, k] = -t1[k] * weights[k], t2[k] * weights[k]
    worst = 0.0
    for i in range(PLACES):
        near = min(_to_segment(blend[i], corner[0], corner[1]), _to_segment(blend[i], corner[1], corner[2]))
        worst = max(worst, near)
    point = np.empty(width)
    half = PLACES // 2
    for i in range(2 * half + 1):
        share = (i - half) / half
        for k in range(width):
            point[k] = -share * corner[0, k] if share < 0.0 else share * corner[2, k]
        near = math.inf
        for j in range(PLACES - 1):
            near = min(near, _to_segment(point, blend[j], blend[j + 1]))
        worst = max(worst, near)
    return math.sqrt(worst) * _POLYLINE


@compiled
def run_time(
    rows: Array,
    offset: NDArray[np.intp],
    edges: Array,
    caps: Array,
    tops: Array,
    limits: Array,
    cycle: float,
    entry: float,
) -> float:
    """How long a short run of segments takes from the speed ``entry`` to rest [s]; infinite: no time law.

    Args:
        rows, offset: samples of the segments. edges, caps, tops: as of `find_keys`, without the caps' bounds.
    """
    n = len(tops)
    for i in range(n):
        joint = max(caps[i], caps[i + 1])
        if edges[i + 1] - edges[i] < SHORT * cycle * joint:
            tops[i] = min(tops[i], joint)
    rest, weak = np.empty((n, 2)), np.empty((n, 2))
    ceiling, kinds = np.empty(len(rows)), np.empty(len(rows), np.int8)
    at_rest = np.empty((len(rows), 2))
    prepare(rows, offset, tops, limits, cycle, rest, weak, ceiling, kinds, at_rest)
    caps[0], caps[n] = entry, 0.0
    for i in range(1, n):
        caps[i] = min(caps[i], tops[i - 1], tops[i])
    if tops[0] < entry:
        caps[0] = tops[0]
    grid = tops.max() * GRID ** np.arange(GRID_SIZE)
    known = np.full((n, GRID_SIZE, 2), math.nan)
    is_key = np.zeros(n + 1, np.bool_)
    is_key[0] = is_key[n] = True
    for i in range(1, n):
        is_key[i] = caps[i] <= 0.0
    status, _, _, _, phases, _ = find_keys(
        edges,
        caps,
        tops,
        np.zeros(n, np.bool_),
        is_key,
        rows,
        offset,
        limits,
        cycle,
        rest,
        weak,
        ceiling,
        kinds,
        at_rest,
        grid,
        known,
        caps[0],
    )
    return phases[:, 0].sum() if status == SOLVED else math.inf


@compiled
def corner_time(
    last: Array,
    first: Array,
    left: float,
    right: float,
    feeds: Array,
    limits: Array,
    cycle: float,
    entry: float,
) -> float:
    """How long two straight segments take whose corner stays.

    Args:
        last, first: travels of the two whole segments, shape (K,). left, right: what is left of them [m].
        feeds: greatest path speeds of the two by their F.
    """
    width = len(last)
    columns = 5 * width + 2
    rows = np.zeros((4, columns))
    still = np.zeros(width)
    lengths = np.array([math.sqrt((last * last).sum()), math.sqrt((first * first).sum())])
    samples = np.zeros((2, columns))
    speed, _ = meet(last, still, lengths[0], first, still, limits, cycle, samples)
    tops = np.empty(2)
    tops[0], _ = line_sample(last, lengths[0], limits, rows[:1])
    rows[1] = samples[0]
    tops[1], _ = line_sample(first, lengths[1], limits, rows[2:3])
    rows[3] = samples[1]
    for i in range(2):
        tops[i] = min(tops[i], feeds[i])
    if not 0.0 < speed < math.inf:
        # no vertex is passed with speed: there is nothing that it asks for
        rows[1], rows[3] = rows[0], rows[2]
    edges = np.array([0.0, left, left + right])
    caps = np.array([entry, speed, 0.0])
    return run_time(rows, np.array([0, 2, 4]), edges, caps, tops, limits, cycle, entry)


@compiled
def blend_time(
    last: Array,
    first: Array,
    left: float,
    right: float,
    feeds: Array,
    limits: Array,
    cycle: float,
    entry: float,
    power: Array,
) -> float:
    """How long they take with this blend, whose reach has been taken off ``left`` and ``right``."""
    width = len(last)
    columns = 5 * width + 2
    rows = np.zeros((2 + 2 * PLACES, columns))
    tops = np.empty(4)
    tops[0], _ = line_sample(last, math.sqrt((last * last).sum()), limits, rows[:1])
    tops[3], _ = line_sample(first, math.sqrt((first * first).sum()), limits, rows[1 + 2 * PLACES :])
    edges = np.empty(5)
    edges[0], edges[1] = 0.0, left
    part = np.empty((6, width))
    speeds = np.empty(PLACES)
    scale = 1.0
    for half in range(2):
        half_of(power, 0.5 * half, 0.5, part)
        where = slice(1 + half * PLACES, 1 + (half + 1) * PLACES)
        polynomial_samples(part, 1.0, rows[where], speeds)
        if half == 0:
            scale = speeds[0]
        # along σ, which goes on where the halves meet
        polynomial_samples(part, scale, rows[where], speeds)
        limit, _, _ = limit_of(rows[where], limits)
        tops[1 + half] = min(limit, feeds[half] * scale / speeds.max())
        edges[2 + half] = edges[1 + half] + scale
    edges[4] = edges[3] + right
    for i in (0, 3):
        tops[i] = min(tops[i], feeds[i // 2])
    caps = np.full(5, math.inf)
    offset = np.array([0, 1, 1 + PLACES, 1 + 2 * PLACES, 2 + 2 * PLACES])
    return run_time(rows, offset, edges, caps, tops, limits, cycle, entry)


@compiled
def entry_speed(last: Array, feed: float, limits: Array) -> float:
    """Half of the speed that a straight segment could have reached from rest in its own length."""
    length = math.sqrt((last * last).sum())
    top, acceleration, jerk = feed, math.inf, math.inf
    for k in range(len(last)):
        slope = abs(last[k]) / length
        if slope > 0.0:
            top = min(top, limits[0, k] / slope)
            acceleration = min(acceleration, limits[1, k] / slope)
            jerk = min(jerk, limits[2, k] / slope)
    return 0.5 * reachable_speed(0.0, length, acceleration, jerk, top)


@compiled
def best_reach(
    last: Array,
    first: Array,
    left: float,
    right: float,
    feeds: Array,
    limits: Array,
    cycle: float,
    power: Array,
    reaches: Array,
) -> float:
    """The reach with which the corner is passed soonest; 0: it stays.

    Args:
        power: of the shape with d = 1. reaches: what is tried, shape (n,). The others: see `corner_time`.
    """
    entry = entry_speed(last, feeds[0], limits)
    least = corner_time(last, first, left, right, feeds, limits, cycle, entry) * (1.0 - 1e-6)
    best = 0.0
    for reach in reaches:
        if not reach > 0.0:
            continue
        time = blend_time(
            last, first, left - reach, right - reach, feeds, limits, cycle, entry, power * reach
        )
        if time < least:
            best, least = reach, time
    return best
