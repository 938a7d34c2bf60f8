"""Find knots that save time: at the ends of a part of a stretch that has lower limits than the rest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.ramp_kernels import (
    MAX_MOVES,
    MAX_TABLE_ROWS,
    MOVE,
    duration_of_moves,
    min_time_moves,
    reachable_speed_by_table,
)
from mcserver.motion.kernels.sample_limits import SLACK, Run, make_limit_table

# A part with less than this share of a stretch's best acceleration or jerk may be a bottleneck.
BOTTLENECK = 0.7


@compiled
def _part_time(
    distance: float, entry: float, exit_: float, limit_table: Array, count: int, moves: Array, spare: Array
) -> float:
    """Return the least time of a part of a stretch between two speeds [s]; infinite where none exists."""
    made = min_time_moves(moves, spare, distance, entry, exit_, limit_table, count)
    return duration_of_moves(moves, made) if made > 0 else math.inf


@compiled
def _share(free_at_vmax: Array, group: int, acceleration: float, jerk: float) -> float:
    """Return the lower share of a group's acceleration and jerk at its top speed in the given ones."""
    share: float = free_at_vmax[group, 0] / acceleration
    return share if math.isinf(jerk) else min(share, free_at_vmax[group, 1] / jerk)


@compiled
def _mark_part(
    run: Run,
    ends: tuple[int, int, int, int],
    edges: Array,
    junction_vmax: Array,
    speeds: Array,
    duration: float,
    marked: NDArray[np.bool_],
) -> bool:
    """Mark the ends of the middle part of a stretch, if knots there save time; return whether they do.

    Args:
        ends: of the three parts; the first and the last one may be empty. duration: present time of the
            stretch [s].
    """
    left, low, high, right = ends
    # limit tables before the part, on it, and after it
    tables = np.empty((3, MAX_TABLE_ROWS, 3))
    sizes = np.zeros(3, np.intp)
    entry, exit_ = speeds[left], speeds[right]
    if low > left:
        sizes[0] = make_limit_table(run, left, low, entry, tables[0])
        ahead = (edges[low] - edges[left]) * (1.0 - 1e-9)
        entry = reachable_speed_by_table(entry, ahead, tables[0], sizes[0], junction_vmax[low])
    if high < right:
        sizes[2] = make_limit_table(run, high, right, exit_, tables[2])
        behind = (edges[right] - edges[high]) * (1.0 - 1e-9)
        exit_ = reachable_speed_by_table(exit_, behind, tables[2], sizes[2], junction_vmax[high])
    sizes[1] = make_limit_table(run, low, high, min(entry, exit_), tables[1])
    inner = (edges[high] - edges[low]) * (1.0 - 1e-9)
    if exit_ > entry:
        exit_ = reachable_speed_by_table(entry, inner, tables[1], sizes[1], exit_)
    else:
        entry = reachable_speed_by_table(exit_, inner, tables[1], sizes[1], entry)
    # inner knots must not be stops, and the speeds at the ends of the stretch stay
    enters = entry >= speeds[left] if low == left else 0.0 < entry <= junction_vmax[low] * SLACK
    leaves = exit_ >= speeds[right] if high == right else 0.0 < exit_ <= junction_vmax[high] * SLACK
    if not (enters and leaves):
        return False
    moves, spare = np.empty((MAX_MOVES, MOVE)), np.empty((MAX_MOVES, MOVE))
    passed = (speeds[left], entry, exit_, speeds[right])
    total = 0.0
    for part in range(3):
        if ends[part + 1] > ends[part]:
            distance = edges[ends[part + 1]] - edges[ends[part]]
            total += _part_time(
                distance, passed[part], passed[part + 1], tables[part], sizes[part], moves, spare
            )
    if not total < duration * (1.0 - 1e-9):
        return False
    marked[low] = marked[low] or low > left
    marked[high] = marked[high] or high < right
    return True


@compiled
def mark_bottlenecks(
    run: Run,
    left: int,
    right: int,
    edges: Array,
    junction_vmax: Array,
    speeds: Array,
    duration: float,
    marked: NDArray[np.bool_],
) -> None:
    """Mark the ends of bottlenecks, parts with little acceleration or jerk, where knots there save time.

    One sharp bend that is passed near its top speed must not slow down the ramps before and after it.

    Args:
        duration: present time of the stretch [s].
    """
    best = best_jerk = 0.0
    for group in range(left, right):
        best, best_jerk = max(best, run.free_at_vmax[group, 0]), max(best_jerk, run.free_at_vmax[group, 1])
    low, least = left, math.inf
    for group in range(left, right):
        share = _share(run.free_at_vmax, group, best, best_jerk)
        if share < least:
            low, least = group, share
    if least > BOTTLENECK:
        return
    # bottlenecks at both ends, as near the vertices of long segments
    first, last = left, right
    while (
        first < right
        and _share(run.free_at_vmax, first, run.free_at_rest[first, 0], run.free_at_rest[first, 1])
        <= BOTTLENECK
    ):
        first += 1
    while (
        last > first
        and _share(run.free_at_vmax, last - 1, run.free_at_rest[last - 1, 0], run.free_at_rest[last - 1, 1])
        <= BOTTLENECK
    ):
        last -= 1
    if first < last:
        for begin, end in ((first, last), (first, right), (left, last)):
            inside = begin > left or end < right
            if inside and _mark_part(
                run, (left, begin, end, right), edges, junction_vmax, speeds, duration, marked
            ):
                return
    # around the group with the lowest share
    high = low + 1
    while low > left and _share(run.free_at_vmax, low - 1, best, best_jerk) <= BOTTLENECK:
        low -= 1
    while high < right and _share(run.free_at_vmax, high, best, best_jerk) <= BOTTLENECK:
        high += 1
    _mark_part(run, (left, low, high, right), edges, junction_vmax, speeds, duration, marked)
