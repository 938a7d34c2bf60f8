"""Acceleration and jerk that the axes leave along the path, over the samples of a run.

A sample is one row of 5 K + 2 numbers for K columns: |q'|, |q''|, |q'''|, |Δq'| and |Δq''| of a vertex, then
the spacing of vertices ℓ and the greatest speed at the vertex (see `mcserver.motion.limits.path_limits`).
Limits are an array (3, K): velocity, acceleration and jerk.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Share of the acceleration that curvature may take at top speed; the rest is for reaching that speed.
CURVATURE_SHARE = 0.97
# Share of the jerk that curvature alone may take.
JERK_SHARE = 0.9
# Speeds of a limit table's rows, as shares of a stretch's lowest top speed; the last one where others are
# higher.
TABLE_SPEEDS = (0.45, 0.65, 0.8, 0.9, 0.96, 1.0)
# Rows below the lowest speed of a vertex, where that is lower, and the grid steps between them.
VERTEX_ROWS, VERTEX_STEP = 4, 4
# These rows are left out if the speed at the ends is at least this share of the vertex's.
VERTEX_SPEED = 0.9
# Rows are on a grid of speeds, the whole powers of this, from the highest one of a run down.
GRID = 0.95
# Number of grid speeds; a limit table has no rows below the last of them.
GRID_SIZE = 128
# Top speeds leave at least this share of the acceleration and jerk available at rest.
LEAST_FREE = 0.01

# Which terms of a sample's demand depend on speed: none, the step of a vertex, all.
CONSTANT, VERTEX, BENT = range(3)

# A segment of fewer cycles has the top speed of its junctions.
SHORT = 5.0

# Tolerance for rounding of a speed and its limit.
SLACK = 1.0 + 1e-9

# Greatest value of 1 + `ripple`.
MOST_RIPPLE = 1.125
# Most reductions by 2 % of a top speed that leaves too little: to a billionth of it.
MOST_LOWERINGS = 1000

TINY = 1e-300
_HUGE = 1e100


class Run(NamedTuple):
    """The n groups of a run, and the limits along the path on them.

    Attributes:
        rows: samples of all groups, shape (m, 5 K + 2). offset: the groups' first samples, and one past the
            last, shape (n+1,).
        segment_vmax: greatest speeds of the groups, shape (n,). limits: of the axes, shape (3, K). cycle:
        [s]. free_at_rest, free_at_vmax: acceleration and jerk available at rest, and at every speed, shape
        (n, 2). sample_vmax: the greatest speed at each sample, shape (m,). min_vmax: the least of them on
            each group, shape (n,). curved: whether a group has curvature, shape (n,).
        speed_terms: `CONSTANT`, `VERTEX` or `BENT`, shape (m,). sample_free_at_rest: acceleration and jerk
            available at rest, shape (m, 2).
        columns: those that move on any sample. grid: speeds, powers of `GRID` from the lowest one that is not
            below any top speed down, shape (g,). free_at_grid: acceleration and jerk of each group at these
            speeds, shape (g, n, 2), computed where ``asked``, shape (g, n).
    """

    rows: Array
    offset: NDArray[np.intp]
    segment_vmax: Array
    limits: Array
    cycle: float
    free_at_rest: Array
    free_at_vmax: Array
    sample_vmax: Array
    min_vmax: Array
    curved: NDArray[np.bool_]
    speed_terms: NDArray[np.int8]
    sample_free_at_rest: Array
    columns: NDArray[np.intp]
    grid: Array
    free_at_grid: Array
    asked: NDArray[np.bool_]


@compiled
def ripple(apart: float) -> float:
    """Return the relative excess of the worst cycle over the average, of vertices ``apart`` ≤ 1 cycles apart.

    A second difference weights them with a hat of two cycles. With f the fraction of 1/r, its sum over
    points r apart is at most (1 + r² f (1 - f)) / r; below 2/3 the bound f (1 - f) ≤ 1/4 is used, which is
    continuous.
    """
    return apart * apart / 4.0 if apart < 2.0 / 3.0 else (1.0 - apart) * (2.0 * apart - 1.0)


@compiled
def _demand_per_step(rows: Array, i: int, width: int, cycle: float, v: float) -> float:
    """Return the acceleration of a unit step of the tangent at speed ``v``, with the vertices near it.

    In 1/s times speed.
    """
    apart = min(rows[i, 5 * width] / max(v * cycle, TINY), 1.0)
    crowd: float = v * (1.0 + ripple(apart)) / apart / cycle
    return crowd


@compiled
def _columns_asked(rows: Array, width: int) -> NDArray[np.intp]:
    """Return the columns that move on any of the samples; all where none does."""
    asks = np.zeros(width, np.bool_)
    for i in range(len(rows)):
        for k in range(5 * width):
            if rows[i, k] > 0.0:
                asks[k % width] = True
    return np.nonzero(asks)[0] if asks.any() else np.arange(width)


@compiled
def free_at(
    rows: Array, i: int, columns: NDArray[np.intp], limits: Array, cycle: float, v: float
) -> tuple[float, float]:
    """Return the acceleration and jerk along σ that the axes leave at speed ``v`` on sample ``i``.

    Args:
        columns: to check; the others do not move on the sample.
    """
    width = limits.shape[1]
    per_step = _demand_per_step(rows, i, width, cycle, v)
    square, cube = v * v, v * v * v
    # a step of acceleration within a cycle is equivalent to this jerk at the cycle rate (the peak of the
    # quadratic B-spline of a third difference)
    per_d2q_step = 0.75 / cycle * square
    acceleration = math.inf
    allowed = math.inf
    for k in columns:
        d2q = rows[i, width + k]
        taken = d2q * square + rows[i, 3 * width + k] * per_step
        acceleration = min(acceleration, (limits[1, k] - taken) / max(rows[i, k], TINY))
        coupling = 3.0 * d2q * v
        if coupling > 0.0:
            left = limits[2, k] - rows[i, 2 * width + k] * cube - rows[i, 4 * width + k] * per_d2q_step
            # acceleration on curvature may use at most half of the remaining jerk
            allowed = min(allowed, 0.5 * left / coupling)
    acceleration = min(acceleration, allowed)
    used = max(acceleration, 0.0)
    jerk = math.inf
    for k in columns:
        left = limits[2, k] - rows[i, 2 * width + k] * cube - rows[i, 4 * width + k] * per_d2q_step
        left -= 3.0 * rows[i, width + k] * v * used
        jerk = min(jerk, left / max(rows[i, k], TINY))
    # an axis that does not move limits nothing: its quotient is huge, not infinite
    return acceleration, math.inf if jerk > _HUGE else jerk


@compiled
def _kind_of(rows: Array, i: int, width: int) -> int:
    """Return which terms of a sample's demand depend on speed: `CONSTANT`, `VERTEX` or `BENT`."""
    kind = CONSTANT
    for k in range(width):
        if rows[i, width + k] > 0.0 or rows[i, 2 * width + k] > 0.0 or rows[i, 4 * width + k] > 0.0:
            return BENT
        if rows[i, 3 * width + k] > 0.0:
            kind = VERTEX
    return kind


@compiled
def _free_of_sample(run: Run, i: int, v: float) -> tuple[float, float]:
    """Return `free_at` of a sample, from precomputed values where it does not depend on speed."""
    kind = run.speed_terms[i]
    if kind == BENT:
        return free_at(run.rows, i, run.columns, run.limits, run.cycle, v)
    acceleration: float = run.sample_free_at_rest[i, 0]
    jerk: float = run.sample_free_at_rest[i, 1]
    if kind == VERTEX:
        width = run.limits.shape[1]
        per_step = _demand_per_step(run.rows, i, width, run.cycle, v)
        acceleration = math.inf
        for k in range(width):
            left = run.limits[1, k] - run.rows[i, 3 * width + k] * per_step
            acceleration = min(acceleration, left / max(run.rows[i, k], TINY))
    return acceleration, jerk


@compiled
def _free_of_group(run: Run, group: int, speed: float) -> tuple[float, float]:
    """Return acceleration and jerk available on a group at ``speed``, or at lower speeds of its samples."""
    acceleration = jerk = math.inf
    for i in range(run.offset[group], run.offset[group + 1]):
        a, j = _free_of_sample(run, i, min(run.sample_vmax[i], speed))
        acceleration, jerk = min(acceleration, a), min(jerk, j)
    return acceleration, jerk


@compiled
def _grid_down_from(top: float) -> Array:
    """Return the speeds of the grid, from the lowest one that is not below ``top`` down.

    They do not depend on the run: the rest of a motion is planned again with the same rows of limit tables,
    so the stop, or the T, that its entry speed was planned for still exists.
    """
    if not 0.0 < top < _HUGE:
        return np.full(GRID_SIZE, top)
    first = math.floor(math.log(top) / math.log(GRID))
    grid = np.empty(GRID_SIZE)
    for place in range(GRID_SIZE):
        grid[place] = GRID ** float(first + place)
    return grid


@compiled
def run_of(rows: Array, offset: NDArray[np.intp], segment_vmax: Array, limits: Array, cycle: float) -> Run:
    """Return the limits at rest and at the top speed of each group of samples.

    Args:
        segment_vmax: lowered where a speed would leave hardly any acceleration or jerk to reach it.
    """
    n, m = len(segment_vmax), len(rows)
    run = Run(
        rows,
        offset,
        segment_vmax,
        limits,
        cycle,
        np.empty((n, 2)),
        np.empty((n, 2)),
        np.empty(m),
        np.empty(n),
        np.empty(n, np.bool_),
        np.empty(m, np.int8),
        np.empty((m, 2)),
        _columns_asked(rows, limits.shape[1]),
        _grid_down_from(segment_vmax.max()),
        np.empty((GRID_SIZE, n, 2)),
        np.zeros((GRID_SIZE, n), np.bool_),
    )
    for group in range(n):
        low, high = offset[group], offset[group + 1]
        full = full_jerk = math.inf
        for i in range(low, high):
            acceleration, jerk = free_at(rows, i, run.columns, limits, cycle, 0.0)
            run.speed_terms[i] = _kind_of(rows, i, limits.shape[1])
            run.sample_free_at_rest[i, 0], run.sample_free_at_rest[i, 1] = acceleration, jerk
            full, full_jerk = min(full, acceleration), min(full_jerk, jerk)
        run.free_at_rest[group, 0], run.free_at_rest[group, 1] = full, full_jerk
        at_top = at_top_jerk = math.inf
        for _ in range(MOST_LOWERINGS):
            for i in range(low, high):
                run.sample_vmax[i] = min(segment_vmax[group], rows[i, rows.shape[1] - 1])
            at_top, at_top_jerk = _free_of_group(run, group, segment_vmax[group])
            short = at_top < LEAST_FREE * full
            if not math.isinf(full_jerk):
                short = short or at_top_jerk < LEAST_FREE * full_jerk
            if not short:
                break
            segment_vmax[group] *= 0.98
        run.free_at_vmax[group, 0], run.free_at_vmax[group, 1] = at_top, at_top_jerk
        run.min_vmax[group] = run.sample_vmax[low:high].min()
        run.curved[group] = run.speed_terms[low:high].max() == BENT
    return run


@compiled
def limit_short_segments(edges: Array, junction_vmax: Array, segment_vmax: Array, cycle: float) -> None:
    """Lower the top speeds (n,) of segments of few cycles to those of their junctions."""
    for i in range(len(segment_vmax)):
        joint = max(junction_vmax[i], junction_vmax[i + 1])
        if edges[i + 1] - edges[i] < SHORT * cycle * joint:
            segment_vmax[i] = min(segment_vmax[i], joint)


@compiled
def limit_junctions(junction_vmax: Array, segment_vmax: Array) -> None:
    """Lower the speeds of junctions (n+1,) to the top speeds of both sides; those at the ends stay."""
    for i in range(1, len(segment_vmax)):
        junction_vmax[i] = min(junction_vmax[i], segment_vmax[i - 1], segment_vmax[i])


@compiled
def min_limits(values: Array, left: int, right: int) -> tuple[float, float]:
    """Return the least acceleration and jerk of groups ``left`` … ``right`` - 1, of an array (n, 2)."""
    acceleration = jerk = math.inf
    for group in range(left, right):
        acceleration, jerk = min(acceleration, values[group, 0]), min(jerk, values[group, 1])
    return acceleration, jerk


@compiled
def _grid_index(run: Run, speed: float) -> int:
    """Return the first index of the grid whose speed is not above ``speed``."""
    return math.ceil(math.log(speed / run.grid[0]) / math.log(GRID) - 1e-9)


@compiled
def _put_row(run: Run, left: int, right: int, place: int, limit_table: Array, at: int) -> int:
    """Write the row of a limit table at one speed of the grid."""
    free, asked = run.free_at_grid[place], run.asked[place]
    for group in range(left, right):
        if not asked[group]:
            free[group, 0], free[group, 1] = _free_of_group(run, group, run.grid[place])
            asked[group] = True
    acceleration, jerk = min_limits(free, left, right)
    limit_table[at, 0], limit_table[at, 1], limit_table[at, 2] = run.grid[place], acceleration, jerk
    return at + 1


@compiled
def make_limit_table(run: Run, left: int, right: int, speed: float, limit_table: Array) -> int:
    """Write the acceleration-limit table of groups ``left`` … ``right`` - 1.

    Its rows are speeds up to the top speed, with the acceleration and jerk available up to each; a single row
    where curvature hardly matters. Low speeds leave nearly all of the acceleration along the path, the top
    speed little: so a start from rest can use more of it. Rows are on the grid, so that the limits at them
    are computed once for each group.

    Args:
        speed: the lower one at the ends: if it is near a vertex's speed, rows below that are not needed.

    Returns:
        The number of rows in ``limit_table``, shape (`MAX_TABLE_ROWS`, 3).
    """
    low = top = run.segment_vmax[left]
    min_vmax = run.min_vmax[left]
    for group in range(left + 1, right):
        low, top = min(low, run.segment_vmax[group]), max(top, run.segment_vmax[group])
        min_vmax = min(min_vmax, run.min_vmax[group])
    at_top, jerk_at_top = min_limits(run.free_at_vmax, left, right)
    full, full_jerk = min_limits(run.free_at_rest, left, right)
    at = 0
    if low > 0.0 and not (at_top >= 0.9 * full and (math.isinf(full_jerk) or jerk_at_top >= 0.9 * full_jerk)):
        last = len(run.grid)
        by_vertex = min_vmax < TABLE_SPEEDS[0] * low
        if by_vertex and speed < VERTEX_SPEED * min_vmax:
            place = _grid_index(run, min_vmax)
            place += -place % VERTEX_STEP + (VERTEX_ROWS - 1) * VERTEX_STEP
            for _ in range(VERTEX_ROWS):
                if place < last:
                    last = place
                    at = _put_row(run, left, right, place, limit_table, at)
                place -= VERTEX_STEP
        # above the speeds of vertices only curvature takes more with speed
        if not by_vertex or run.curved[left:right].any():
            for share in TABLE_SPEEDS:
                if share == 1.0 and top <= low * 1.001:
                    continue
                place = _grid_index(run, share * low)
                if place < last:
                    last = place
                    at = _put_row(run, left, right, place, limit_table, at)
    limit_table[at, 0], limit_table[at, 1], limit_table[at, 2] = top, at_top, jerk_at_top
    return at + 1
