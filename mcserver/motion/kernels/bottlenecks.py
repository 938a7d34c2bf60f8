"""Keys that save time: where parts of a stretch leave better or worse limits than the whole."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.ramp_kernels import (
    MOST_MOVES,
    MOST_RUNGS,
    MOVE,
    duration_of,
    fastest_moves,
    reachable,
)
from mcserver.motion.kernels.sample_limits import SLACK, Run, make_ladder, weakest

# A part that leaves less than this share of a stretch's best acceleration or jerk may get keys of its own.
WEAK = 0.7


@compiled
def mark_plateau(
    left: int,
    right: int,
    edges: Array,
    caps: Array,
    weak: Array,
    moves: Array,
    count: int,
    found: NDArray[np.bool_],
) -> None:
    """Marks nodes passed at constant top speed whose outer sides have better limits than the whole."""
    top = 0.0
    for index in range(count):
        top = max(top, moves[index, 0], moves[index, 1])
    place = edges[left]
    first = last = math.nan
    for index in range(count):
        if moves[index, 0] == moves[index, 1] and moves[index, 0] >= top * (1.0 - 1e-12):
            first, last = place, place + moves[index, 4]
        place += moves[index, 4]
    if math.isnan(first):
        return
    if max(weak[left, 0], weak[right - 1, 0]) <= 1.1 * weakest(weak, left, right)[0]:
        return
    low = high = -1
    for node in range(left + 1, right):
        if first <= edges[node] <= last:
            if low < 0:
                low = node
            high = node
    if low < 0:
        return
    for node in (low, high):
        found[node] = True
        caps[node] = min(caps[node], top)


@compiled
def _part_time(
    distance: float, entry: float, exit_: float, ladder: Array, count: int, moves: Array, spare: Array
) -> float:
    """How long a part of a stretch takes between two speeds [s]; infinite where they cannot be joined."""
    found = fastest_moves(moves, spare, distance, entry, exit_, ladder, count)
    return duration_of(moves, found) if found > 0 else math.inf


@compiled
def _share(weak: Array, group: int, acceleration: float, jerk: float) -> float:
    """What a group leaves at its top speed, as a share of these; of acceleration or jerk, the less."""
    share: float = weak[group, 0] / acceleration
    return share if math.isinf(jerk) else min(share, weak[group, 1] / jerk)


@compiled
def _mark_part(
    run: Run,
    ends: tuple[int, int, int, int],
    edges: Array,
    caps: Array,
    speeds: Array,
    lasts: float,
    found: NDArray[np.bool_],
) -> bool:
    """Marks the ends of the middle part of a stretch, if keys there save time; whether they do.

    Args:
        ends: of the three parts; the first and the last one may be empty. lasts: time as it is [s].
    """
    left, low, high, right = ends
    # of what lies before the part, of the part, and of what lies behind it
    ladders = np.empty((3, MOST_RUNGS, 3))
    sizes = np.zeros(3, np.intp)
    entry, exit_ = speeds[left], speeds[right]
    if low > left:
        sizes[0] = make_ladder(run, left, low, entry, ladders[0])
        ahead = (edges[low] - edges[left]) * (1.0 - 1e-9)
        entry = reachable(entry, ahead, ladders[0], sizes[0], caps[low])
    if high < right:
        sizes[2] = make_ladder(run, high, right, exit_, ladders[2])
        behind = (edges[right] - edges[high]) * (1.0 - 1e-9)
        exit_ = reachable(exit_, behind, ladders[2], sizes[2], caps[high])
    sizes[1] = make_ladder(run, low, high, min(entry, exit_), ladders[1])
    inner = (edges[high] - edges[low]) * (1.0 - 1e-9)
    if exit_ > entry:
        exit_ = reachable(entry, inner, ladders[1], sizes[1], exit_)
    else:
        entry = reachable(exit_, inner, ladders[1], sizes[1], entry)
    # a key inside is passed at a speed, and the speeds at the ends stay
    enters = entry >= speeds[left] if low == left else 0.0 < entry <= caps[low] * SLACK
    leaves = exit_ >= speeds[right] if high == right else 0.0 < exit_ <= caps[high] * SLACK
    if not (enters and leaves):
        return False
    moves, spare = np.empty((MOST_MOVES, MOVE)), np.empty((MOST_MOVES, MOVE))
    passed = (speeds[left], entry, exit_, speeds[right])
    total = 0.0
    for part in range(3):
        if ends[part + 1] > ends[part]:
            distance = edges[ends[part + 1]] - edges[ends[part]]
            total += _part_time(
                distance, passed[part], passed[part + 1], ladders[part], sizes[part], moves, spare
            )
    if not total < lasts * (1.0 - 1e-9):
        return False
    found[low] = found[low] or low > left
    found[high] = found[high] or high < right
    return True


@compiled
def mark_weak(
    run: Run,
    left: int,
    right: int,
    edges: Array,
    caps: Array,
    speeds: Array,
    lasts: float,
    found: NDArray[np.bool_],
) -> None:
    """Marks the ends of parts that leave little acceleration or jerk, where keys there save time.

    One sharp bend that is passed near its top speed must not slow down the way to it and from it.

    Args:
        lasts: time of the stretch as it is [s].
    """
    best = best_jerk = 0.0
    for group in range(left, right):
        best, best_jerk = max(best, run.weak[group, 0]), max(best_jerk, run.weak[group, 1])
    low, least = left, math.inf
    for group in range(left, right):
        share = _share(run.weak, group, best, best_jerk)
        if share < least:
            low, least = group, share
    if least > WEAK:
        return
    # what leaves little of its own at both ends, as near the vertices of long segments
    first, last = left, right
    while first < right and _share(run.weak, first, run.rest[first, 0], run.rest[first, 1]) <= WEAK:
        first += 1
    while last > first and _share(run.weak, last - 1, run.rest[last - 1, 0], run.rest[last - 1, 1]) <= WEAK:
        last -= 1
    if first < last:
        for begin, end in ((first, last), (first, right), (left, last)):
            inside = begin > left or end < right
            if inside and _mark_part(run, (left, begin, end, right), edges, caps, speeds, lasts, found):
                return
    # the weakest of all
    high = low + 1
    while low > left and _share(run.weak, low - 1, best, best_jerk) <= WEAK:
        low -= 1
    while high < right and _share(run.weak, high, best, best_jerk) <= WEAK:
        high += 1
    _mark_part(run, (left, low, high, right), edges, caps, speeds, lasts, found)
