"""What the axes leave free along the path, over the samples of a run.

A sample is one row of 5 K + 2 numbers for K columns: |q'|, |q''|, |q'''|, a vertex's |Δq'|, |Δq''| where the
bend steps, then the spacing of vertices ℓ and a speed that is not passed there (see
`mcserver.motion.limits`). Limits are an array (3, K): velocity, acceleration and jerk.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.path import Array

# Share of the acceleration that curvature may take at top speed; the rest is left for the way there.
CURVATURE_SHARE = 0.97
# Share of the jerk that curvature alone may take.
JERK_SHARE = 0.9
# Speeds of the rungs, as shares of the lowest top speed of a stretch; the last one where others are higher.
RUNGS = (0.45, 0.65, 0.8, 0.9, 0.96, 1.0)
# Rungs stand on a grid of speeds from the highest one down, each this share of the one above; below the last
# of them a ladder has no rungs.
GRID = 0.95
GRID_SIZE = 128
# Top speeds leave at least this share of the acceleration and jerk that are free at rest.
LEAST_FREE = 0.01

# What of a sample's demand depends on speed: nothing, a vertex's step, all.
CONSTANT, VERTEX, BENT = range(3)

TINY = 1e-300
_HUGE = 1e100


@compiled
def ripple(apart: float) -> float:
    """How much more than on average vertices ``apart`` ≤ 1 cycles from each other weigh at the worst cycle.

    A second difference weighs them with a hat of two cycles. With f the fraction of 1/r, its sum over
    points r apart is at most (1 + r² f (1 - f)) / r; below 2/3 the bound f (1 - f) ≤ 1/4 serves, which
    has no jumps.
    """
    return apart * apart / 4.0 if apart < 2.0 / 3.0 else (1.0 - apart) * (2.0 * apart - 1.0)


@compiled
def free_at(rows: Array, i: int, limits: Array, cycle: float, v: float) -> tuple[float, float]:
    """Acceleration and jerk along σ that the axes leave free at speed ``v`` on sample ``i``."""
    width = limits.shape[1]
    apart = min(rows[i, 5 * width] / max(v * cycle, TINY), 1.0)
    crowded = v * (1.0 + ripple(apart)) / apart / cycle
    square, cube = v * v, v * v * v
    # a step of the acceleration within a cycle looks like this jerk at the cycle rate (peak of the
    # quadratic B-spline that a third difference is)
    kicked = 0.75 / cycle * square
    acceleration = math.inf
    allowed = math.inf
    for k in range(width):
        bend = rows[i, width + k]
        taken = bend * square + rows[i, 3 * width + k] * crowded
        acceleration = min(acceleration, (limits[1, k] - taken) / max(rows[i, k], TINY))
        coupling = 3.0 * bend * v
        if coupling > 0.0:
            left = limits[2, k] - rows[i, 2 * width + k] * cube - rows[i, 4 * width + k] * kicked
            # half of what is left of the jerk is the most that acceleration across the bend may use
            allowed = min(allowed, 0.5 * left / coupling)
    acceleration = min(acceleration, allowed)
    used = max(acceleration, 0.0)
    jerk = math.inf
    for k in range(width):
        left = limits[2, k] - rows[i, 2 * width + k] * cube - rows[i, 4 * width + k] * kicked
        left -= 3.0 * rows[i, width + k] * v * used
        jerk = min(jerk, left / max(rows[i, k], TINY))
    # an axis that does not move limits nothing: its quotient is huge, not infinite
    return acceleration, math.inf if jerk > _HUGE else jerk


@compiled
def _kind_of(rows: Array, i: int, width: int) -> int:
    """Which of what a sample asks for depends on speed."""
    kind = CONSTANT
    for k in range(width):
        if rows[i, width + k] > 0.0 or rows[i, 2 * width + k] > 0.0 or rows[i, 4 * width + k] > 0.0:
            return BENT
        if rows[i, 3 * width + k] > 0.0:
            kind = VERTEX
    return kind


@compiled
def _free(
    rows: Array, i: int, limits: Array, cycle: float, v: float, kind: int, at_rest: Array
) -> tuple[float, float]:
    """As `free_at`, with what is known of the sample: what is free at rest, shape (m, 2)."""
    if kind == BENT:
        return free_at(rows, i, limits, cycle, v)
    acceleration: float = at_rest[i, 0]
    jerk: float = at_rest[i, 1]
    if kind == VERTEX:
        width = limits.shape[1]
        apart = min(rows[i, 5 * width] / max(v * cycle, TINY), 1.0)
        crowded = v * (1.0 + ripple(apart)) / apart / cycle
        acceleration = math.inf
        for k in range(width):
            left = limits[1, k] - rows[i, 3 * width + k] * crowded
            acceleration = min(acceleration, left / max(rows[i, k], TINY))
    return acceleration, jerk


@compiled
def prepare(
    rows: Array,
    offset: NDArray[np.intp],
    tops: Array,
    limits: Array,
    cycle: float,
    rest: Array,
    weak: Array,
    ceiling: Array,
    kinds: NDArray[np.int8],
    at_rest: Array,
) -> None:
    """What is free at rest and at the top speed of each group of samples.

    Args:
        offset: first samples of the groups, and one past the last, shape (n+1,).
        tops: greatest speeds of the groups (n,); lowered where a speed would leave hardly any acceleration
            or jerk to get to it.
        rest, weak: shape (n, 2), written: acceleration and jerk free at rest, and at every speed.
        ceiling: shape (m,), written: the greatest speed at each sample. kinds, at_rest: shape (m,) and
            (m, 2), written: what of a sample depends on speed, and what it leaves free at rest.
    """
    for group in range(len(tops)):
        low, high = offset[group], offset[group + 1]
        full = full_jerk = math.inf
        for i in range(low, high):
            acceleration, jerk = free_at(rows, i, limits, cycle, 0.0)
            kinds[i] = _kind_of(rows, i, limits.shape[1])
            at_rest[i, 0], at_rest[i, 1] = acceleration, jerk
            full, full_jerk = min(full, acceleration), min(full_jerk, jerk)
        rest[group, 0], rest[group, 1] = full, full_jerk
        at_top = at_top_jerk = math.inf
        for _ in range(200):
            at_top = at_top_jerk = math.inf
            for i in range(low, high):
                ceiling[i] = min(tops[group], rows[i, rows.shape[1] - 1])
                acceleration, jerk = _free(rows, i, limits, cycle, ceiling[i], kinds[i], at_rest)
                at_top, at_top_jerk = min(at_top, acceleration), min(at_top_jerk, jerk)
            short = at_top < LEAST_FREE * full
            if not math.isinf(full_jerk):
                short = short or at_top_jerk < LEAST_FREE * full_jerk
            if not short:
                break
            tops[group] *= 0.98
        weak[group, 0], weak[group, 1] = at_top, at_top_jerk


@compiled
def weakest(values: Array, left: int, right: int) -> tuple[float, float]:
    """Least acceleration and jerk of groups ``left`` … ``right`` - 1, of an array (n, 2)."""
    acceleration = jerk = math.inf
    for group in range(left, right):
        acceleration, jerk = min(acceleration, values[group, 0]), min(jerk, values[group, 1])
    return acceleration, jerk


@compiled
def _rung(
    rows: Array,
    offset: NDArray[np.intp],
    ceiling: Array,
    kinds: NDArray[np.int8],
    at_rest: Array,
    left: int,
    right: int,
    limits: Array,
    cycle: float,
    grid: Array,
    known: Array,
    place: int,
    out: Array,
    at: int,
) -> int:
    """Writes the rung at one speed of the grid."""
    acceleration = jerk = math.inf
    for group in range(left, right):
        if math.isnan(known[group, place, 0]):
            least = least_jerk = math.inf
            for i in range(offset[group], offset[group + 1]):
                speed = min(ceiling[i], grid[place])
                a, j = _free(rows, i, limits, cycle, speed, kinds[i], at_rest)
                least, least_jerk = min(least, a), min(least_jerk, j)
            known[group, place, 0], known[group, place, 1] = least, least_jerk
        acceleration = min(acceleration, known[group, place, 0])
        jerk = min(jerk, known[group, place, 1])
    out[at, 0], out[at, 1], out[at, 2] = grid[place], acceleration, jerk
    return at + 1


@compiled
def make_ladder(
    rows: Array,
    offset: NDArray[np.intp],
    tops: Array,
    limits: Array,
    cycle: float,
    rest: Array,
    weak: Array,
    ceiling: Array,
    kinds: NDArray[np.int8],
    at_rest: Array,
    grid: Array,
    known: Array,
    left: int,
    right: int,
    out: Array,
) -> int:
    """A ladder of speeds up to the top of groups ``left`` … ``right`` - 1 with what is free up to each; one
    rung where bends hardly count.

    Low speeds leave nearly all of the acceleration to the way along the path, the top speed little: the
    ladder lets a start from rest use what is there. Its rungs stand on the grid, so that what is free at them
    is found once for each group.

    Args:
        grid: falling speeds, each `GRID` times the one before, shape (g,). known: shape (n, g, 2), what is
            free of a group at each of them; NaN where nobody has asked yet.

    Returns:
        How many rungs there are in ``out``, shape (`MOST_RUNGS`, 3).
    """
    low = top = tops[left]
    for group in range(left + 1, right):
        low, top = min(low, tops[group]), max(top, tops[group])
    at_top, jerk_at_top = weakest(weak, left, right)
    full, full_jerk = weakest(rest, left, right)
    at = 0
    if low > 0.0 and not (at_top >= 0.9 * full and (math.isinf(full_jerk) or jerk_at_top >= 0.9 * full_jerk)):
        last = -1
        for share in RUNGS:
            if share == 1.0 and top <= low * 1.001:
                continue
            place = math.ceil(math.log(share * low / grid[0]) / math.log(GRID) - 1e-9)
            if place >= len(grid) or place == last:
                continue
            last = place
            at = _rung(
                rows, offset, ceiling, kinds, at_rest, left, right, limits, cycle, grid, known, place, out, at
            )
    out[at, 0], out[at, 1], out[at, 2] = top, at_top, jerk_at_top
    return at + 1
