"""The keys of a run: the nodes at which acceleration is zero, found by the caps that bind.

See `mcserver.motion.profile.profile_solver`. A run of n groups of segments has edges
(n+1,) along σ, and its nodes caps (n+1,).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.bottlenecks import mark_plateau, mark_weak
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.phases import PHASE, PHASES_A_MOVE, expand, speeds_at
from mcserver.motion.kernels.ramp_kernels import (
    MOST_MOVES,
    MOST_RUNGS,
    MOVE,
    duration_of,
    fastest_moves,
    reachable,
)
from mcserver.motion.kernels.sample_limits import SLACK, Run, make_ladder, weakest

# How a search ends.
SOLVED, ENTRY_TOO_FAST, NOT_JOINED, TOO_MANY_ROUNDS = range(4)


class Ladders(NamedTuple):
    """The ladder of the stretch from each key to the next one on its right.

    Attributes:
        rungs: shape (n+1, `MOST_RUNGS`, 3). sizes: how many there are. right: the key that they reach to.
    """

    rungs: Array
    sizes: NDArray[np.intp]
    right: NDArray[np.intp]


class Passes(NamedTuple):
    """What was asked last about each key, forward and backward, and the answer.

    Attributes:
        asked: the other key, its speed, and the cap, shape (2, n+1, 3). answer: speeds, shape (2, n+1).
    """

    asked: Array
    answer: Array


MOST_PHASES = MOST_MOVES * PHASES_A_MOVE


@compiled
def _stretch(
    run: Run, ladders: Ladders, left: int, right: int, edges: Array, speeds: Array, moves: Array, spare: Array
) -> int:
    """Moves between two keys as if no cap bound them between; 0: the speeds cannot be joined."""
    entry, exit_, distance = speeds[left], speeds[right], edges[right] - edges[left]
    found = fastest_moves(moves, spare, distance, entry, exit_, ladders.rungs[left], ladders.sizes[left])
    if found == 0:
        # the speeds were chosen for the weakest of the limits: with these they can be joined
        one = np.empty((1, 3))
        one[0, 0] = max(entry, exit_, run.tops[left:right].min())
        one[0, 1], one[0, 2] = weakest(run.weak, left, right)
        found = fastest_moves(moves, spare, distance, entry, exit_, one, len(one))
    return found


@compiled
def _worst(
    left: int, right: int, edges: Array, caps: Array, tops: Array, phases: Array, count: int, speeds: Array
) -> int:
    """The node to bind: one at the lowest cap which the phases pass; −1: none."""
    origin = edges[left]
    speeds_at(phases, count, edges, origin, left + 1, right, speeds)
    worst, lowest = -1, math.inf
    for node in range(left + 1, right):
        if speeds[node] > caps[node] * SLACK and caps[node] < lowest:
            worst, lowest = node, caps[node]
    # speed rises to one peak and falls: elsewhere the greatest is at an end of a segment
    peak = 0
    for row in range(1, count):
        if phases[row, 2] > phases[peak, 2]:
            peak = row
    where = left
    while where < right - 1 and edges[where + 1] - origin <= phases[peak, 1]:
        where += 1
    segment, least = -1, math.inf
    for group in range(left, right):
        speed = max(speeds[group], speeds[group + 1])
        if group == where:
            speed = max(speed, phases[peak, 2])
        if speed > tops[group] * SLACK and tops[group] < least:
            segment, least = group, tops[group]
    if segment >= 0 and least < lowest:
        # a segment is bound by keys at both of its ends: the one that is not a key yet
        worst = segment if segment > left else segment + 1
    return worst


@compiled
def _surely_worst(left: int, right: int, caps: Array, tops: Array, least: float) -> int:
    """The node that `_worst` gives, where that is clear without a profile; −1: it is not.

    Speed rises to one peak and falls, so it is nowhere below ``least``, the lower of the speeds at the ends.
    """
    node, cap = -1, math.inf
    for other in range(left + 1, right):
        if caps[other] < cap:
            node, cap = other, caps[other]
    segment, top = left, tops[left]
    for other in range(left + 1, right):
        if tops[other] < top:
            segment, top = other, tops[other]
    if min(cap, top) * SLACK >= least:
        return -1
    if top < cap:
        return segment if segment > left else segment + 1
    return node


@compiled
def _speeds_at_keys(
    run: Run,
    keys: NDArray[np.intp],
    edges: Array,
    caps: Array,
    ladders: Ladders,
    passes: Passes,
    speeds: Array,
) -> None:
    """Writes speeds at keys, each of which can be reached from its neighbours: by two passes."""
    count = len(keys)
    for key in keys:
        speeds[key] = caps[key]
    for index in range(count - 1):
        left, right = keys[index], keys[index + 1]
        if ladders.right[left] != right:
            lower = min(caps[left], caps[right])
            ladders.sizes[left] = make_ladder(run, left, right, lower, ladders.rungs[left])
            ladders.right[left] = right
    for way in range(2):
        for step in range(count - 1):
            index = step if way == 0 else count - 2 - step
            left, right = keys[index], keys[index + 1]
            other, key = (left, right) if way == 0 else (right, left)
            if speeds[key] <= speeds[other]:
                continue
            question = passes.asked[way, key]
            if question[0] != other or question[1] != speeds[other] or question[2] != speeds[key]:
                question[0], question[1], question[2] = other, speeds[other], speeds[key]
                distance = (edges[right] - edges[left]) * (1.0 - 1e-9)
                passes.answer[way, key] = reachable(
                    speeds[other], distance, ladders.rungs[left], ladders.sizes[left], speeds[key]
                )
            speeds[key] = passes.answer[way, key]


@compiled
def _time_law(
    run: Run, keys: NDArray[np.intp], edges: Array, timed: NDArray[np.bool_], ladders: Ladders, speeds: Array
) -> tuple[int, Array, NDArray[np.intp]]:
    """The group whose stretch cannot be joined (−1: none), and the phases as `find_keys` gives them."""
    moves, spare = np.empty((MOST_MOVES, MOVE)), np.empty((MOST_MOVES, MOVE))
    firsts = np.full(len(keys) - 1, -1, np.intp)
    phases = np.empty((MOST_PHASES * len(firsts), PHASE))
    at = 0
    for index in range(len(firsts)):
        left, right = keys[index], keys[index + 1]
        if timed[left]:
            continue
        made = _stretch(run, ladders, left, right, edges, speeds, moves, spare)
        if made == 0:
            return left, phases[:at], firsts
        firsts[index] = at
        at = expand(moves, made, phases, at, edges[left])
    return -1, phases[:at], firsts


@compiled
def find_keys(
    run: Run,
    edges: Array,
    caps: Array,
    timed: NDArray[np.bool_],
    is_key: NDArray[np.bool_],
    entry: float,
    plain: bool,
) -> tuple[int, int, NDArray[np.intp], Array, Array, NDArray[np.intp]]:
    """Adds keys until no stretch between two of them passes a cap, and gives the stretches' phases.

    Each round binds the lowest cap of each stretch that passes one. Timed groups stand between keys of their
    own; their time laws are the caller's.

    Args:
        caps: lowered where plateaus begin and end. timed: shape (n,). is_key: shape (n+1,), written.
        entry: speed at the beginning. plain: no keys that only save time.

    Returns:
        How it ended and the group that is to blame; the keys and their speeds, shape (k,) each; the phases of
        all stretches without a time of their own with σ counted from the run's start, and for each stretch
        its first phase (−1: timed), shape (k-1,).
    """
    n = len(run.tops)
    tops = run.tops
    ladders = Ladders(np.empty((n + 1, MOST_RUNGS, 3)), np.zeros(n + 1, np.intp), np.full(n + 1, -1, np.intp))
    passes = Passes(np.full((2, n + 1, 3), math.nan), np.zeros((2, n + 1)))
    # stretches that pass no cap: the key at their right, and the speeds at both
    settled = np.full((n + 1, 3), math.nan)
    split = np.zeros(n + 1, np.bool_)
    found = np.zeros(n + 1, np.bool_)
    moves, spare = np.empty((MOST_MOVES, MOVE)), np.empty((MOST_MOVES, MOVE))
    phases = np.empty((MOST_PHASES, PHASE))
    node_speeds = np.zeros(n + 1)
    speeds = np.zeros(n + 1)
    keys = np.nonzero(is_key)[0]
    status, blamed = TOO_MANY_ROUNDS, 0
    for _ in range(4 * n + 8):
        _speeds_at_keys(run, keys, edges, caps, ladders, passes, speeds)
        if speeds[0] < entry * (1.0 - 1e-9):
            # the speed that is already there cannot be brought down by the limits assumed here
            status = ENTRY_TOO_FAST
            break
        found[:] = False
        for index in range(len(keys) - 1):
            left, right = keys[index], keys[index + 1]
            start, end = speeds[left], speeds[right]
            if right - left == 1:
                continue
            if settled[left, 0] == right and settled[left, 1] == start and settled[left, 2] == end:
                continue
            sure = _surely_worst(left, right, caps, tops, min(start, end))
            if sure >= 0:
                found[sure] = True
                continue
            made = _stretch(run, ladders, left, right, edges, speeds, moves, spare)
            if made == 0:
                status, blamed = NOT_JOINED, left
                break
            written = expand(moves, made, phases, 0, 0.0)
            node_speeds[left], node_speeds[right] = start, end
            worst = _worst(left, right, edges, caps, tops, phases, written, node_speeds)
            if worst >= 0:
                found[worst] = True
            else:
                if not (split[left] and split[right]):
                    mark_plateau(left, right, edges, caps, run.weak, moves, made, found)
                    split[left] = split[right] = True
                    for node in range(left + 1, right):
                        split[node] = split[node] or found[node]
                if not plain and not found[left + 1 : right].any():
                    mark_weak(run, left, right, edges, caps, speeds, duration_of(moves, made), found)
            settled[left, 0], settled[left, 1], settled[left, 2] = right, start, end
        if status == NOT_JOINED:
            break
        if not found.any():
            status = SOLVED
            break
        is_key |= found
        keys = np.nonzero(is_key)[0]
    if status != SOLVED:
        return status, blamed, keys, speeds[keys], phases[:0], keys[:0]
    unjoined, law, firsts = _time_law(run, keys, edges, timed, ladders, speeds)
    if unjoined >= 0:
        status, blamed = NOT_JOINED, unjoined
    return status, blamed, keys, speeds[keys], law, firsts
