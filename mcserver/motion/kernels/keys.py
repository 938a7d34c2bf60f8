"""The keys of a run: the nodes at which acceleration is zero, found by the caps that bind.

See `mcserver.motion.keys`. A run is given by its groups of segments, n of them: edges (n+1,) along σ, the
caps of the nodes (n+1,), top speeds (n,), and their samples with what is free on them (see
`mcserver.motion.kernels.limits`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.limits import make_ladder, weakest
from mcserver.motion.kernels.phases import PHASE, PHASES_A_MOVE, expand, speeds_at
from mcserver.motion.kernels.ramps import MOST_MOVES, MOST_RUNGS, MOVE, fastest_moves, reachable
from mcserver.motion.path import Array

# How a search ends.
SOLVED, ENTRY_TOO_FAST, NOT_JOINED, TOO_MANY_ROUNDS = range(4)

_SLACK = 1.0 + 1e-9
MOST_PHASES = MOST_MOVES * PHASES_A_MOVE


@compiled
def _stretch(
    distance: float,
    entry: float,
    exit_: float,
    ladder: Array,
    count: int,
    tops: Array,
    weak: Array,
    left: int,
    right: int,
    moves: Array,
    spare: Array,
) -> int:
    """Moves between two keys as if no cap bound them between; 0: the speeds cannot be joined."""
    found = fastest_moves(moves, spare, distance, entry, exit_, ladder, count)
    if found == 0:
        # the speeds were chosen for the weakest of the limits: with these they can be joined
        one = np.empty((1, 3))
        least = tops[left]
        for group in range(left + 1, right):
            least = min(least, tops[group])
        one[0, 0] = max(max(entry, exit_), least)
        one[0, 1], one[0, 2] = weakest(weak, left, right)
        found = fastest_moves(moves, spare, distance, entry, exit_, one, 1)
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
        if speeds[node] > caps[node] * _SLACK and caps[node] < lowest:
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
        if speed > tops[group] * _SLACK and tops[group] < least:
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
    if min(cap, top) * _SLACK >= least:
        return -1
    if top < cap:
        return segment if segment > left else segment + 1
    return node


@compiled
def _plateau(
    left: int,
    right: int,
    edges: Array,
    caps: Array,
    weak: Array,
    moves: Array,
    count: int,
    found: NDArray[np.bool_],
) -> bool:
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
        return False
    if max(weak[left, 0], weak[right - 1, 0]) <= 1.1 * weakest(weak, left, right)[0]:
        return False
    low = high = -1
    for node in range(left + 1, right):
        if first <= edges[node] <= last:
            if low < 0:
                low = node
            high = node
    if low < 0:
        return False
    for node in (low, high):
        found[node] = True
        caps[node] = min(caps[node], top)
    return True


@compiled
def find_keys(
    edges: Array,
    caps: Array,
    tops: Array,
    timed: NDArray[np.bool_],
    is_key: NDArray[np.bool_],
    rows: Array,
    offset: NDArray[np.intp],
    limits: Array,
    cycle: float,
    rest: Array,
    weak: Array,
    ceiling: Array,
    kinds: NDArray[np.int8],
    at_rest: Array,
    grid: Array,
    known: Array,
    entry: float,
) -> tuple[int, int, NDArray[np.intp], Array, Array, NDArray[np.intp]]:
    """Adds keys until no stretch between two of them passes a cap, and gives the stretches' phases.

    Each round binds the lowest cap of each stretch that passes one. Timed groups stand between keys of their
    own; their time laws are the caller's.

    Args:
        caps: lowered where plateaus begin and end. timed: shape (n,). is_key: shape (n+1,), written.
        entry: speed at the beginning.

    Returns:
        How it ended and the group that is to blame; the keys and their speeds, shape (k,) each; the phases of
        all stretches without a time of their own with σ counted from the run's start, and for each stretch
        its first phase (−1: timed), shape (k-1,).
    """
    n = len(tops)
    # what was asked and answered at each key, about the stretch to the next key on its right
    ladders = np.empty((n + 1, MOST_RUNGS, 3))
    rungs = np.zeros(n + 1, np.intp)
    ladder_to = np.full(n + 1, -1, np.intp)
    settled = np.full((n + 1, 3), math.nan)
    # the passes' questions (other key, its speed, cap) and answers, forward and backward
    asked = np.full((2, n + 1, 3), math.nan)
    answer = np.zeros((2, n + 1))
    split = np.zeros(n + 1, np.bool_)
    found = np.zeros(n + 1, np.bool_)
    moves, spare = np.empty((MOST_MOVES, MOVE)), np.empty((MOST_MOVES, MOVE))
    phases = np.empty((MOST_PHASES, PHASE))
    node_speeds = np.zeros(n + 1)
    speeds = np.zeros(n + 1)
    keys = np.nonzero(is_key)[0]
    status, blamed = TOO_MANY_ROUNDS, 0
    for _ in range(4 * n + 8):
        count = len(keys)
        for key in keys:
            speeds[key] = caps[key]
        for index in range(count - 1):
            left, right = keys[index], keys[index + 1]
            if ladder_to[left] != right:
                rungs[left] = make_ladder(
                    rows,
                    offset,
                    tops,
                    limits,
                    cycle,
                    rest,
                    weak,
                    ceiling,
                    kinds,
                    at_rest,
                    grid,
                    known,
                    left,
                    right,
                    ladders[left],
                )
                ladder_to[left] = right
        # forward and backward pass: each speed can be reached from the neighbours
        for way in range(2):
            for step in range(count - 1):
                index = step if way == 0 else count - 2 - step
                left, right = keys[index], keys[index + 1]
                other, key = (left, right) if way == 0 else (right, left)
                if speeds[key] <= speeds[other]:
                    continue
                question = asked[way, key]
                if question[0] != other or question[1] != speeds[other] or question[2] != speeds[key]:
                    question[0], question[1], question[2] = other, speeds[other], speeds[key]
                    distance = (edges[right] - edges[left]) * (1.0 - 1e-9)
                    answer[way, key] = reachable(
                        speeds[other], distance, ladders[left], rungs[left], speeds[key]
                    )
                speeds[key] = answer[way, key]
        if speeds[0] < entry * (1.0 - 1e-9):
            # the speed that is already there cannot be brought down by the limits assumed here
            status = ENTRY_TOO_FAST
            break
        found[:] = False
        any_found = failed = False
        for index in range(count - 1):
            left, right = keys[index], keys[index + 1]
            if right - left == 1:
                continue
            if (
                settled[left, 0] == right
                and settled[left, 1] == speeds[left]
                and settled[left, 2] == speeds[right]
            ):
                continue
            sure = _surely_worst(left, right, caps, tops, min(speeds[left], speeds[right]))
            if sure >= 0:
                found[sure] = True
                any_found = True
                continue
            distance = edges[right] - edges[left]
            made = _stretch(
                distance,
                speeds[left],
                speeds[right],
                ladders[left],
                rungs[left],
                tops,
                weak,
                left,
                right,
                moves,
                spare,
            )
            if made == 0:
                status, blamed, failed = NOT_JOINED, left, True
                break
            written = expand(moves, made, phases, 0, 0.0)
            node_speeds[left], node_speeds[right] = speeds[left], speeds[right]
            worst = _worst(left, right, edges, caps, tops, phases, written, node_speeds)
            if worst >= 0:
                found[worst] = True
                any_found = True
            elif not (split[left] and split[right]):
                if _plateau(left, right, edges, caps, weak, moves, made, found):
                    any_found = True
                    for node in range(left, right + 1):
                        split[node] = split[node] or found[node] or node in (left, right)
                else:
                    split[left] = split[right] = True
            settled[left, 0], settled[left, 1], settled[left, 2] = right, speeds[left], speeds[right]
        if failed:
            break
        if not any_found:
            status = SOLVED
            break
        is_key |= found
        keys = np.nonzero(is_key)[0]
    count = len(keys)
    key_speeds = np.empty(count)
    for index in range(count):
        key_speeds[index] = speeds[keys[index]]
    firsts = np.full(max(count - 1, 0), -1, np.intp)
    out = np.empty((MOST_PHASES * (count - 1) if status == SOLVED else 0, PHASE))
    at = 0
    if status == SOLVED:
        for index in range(count - 1):
            left, right = keys[index], keys[index + 1]
            if timed[left]:
                continue
            made = _stretch(
                edges[right] - edges[left],
                speeds[left],
                speeds[right],
                ladders[left],
                rungs[left],
                tops,
                weak,
                left,
                right,
                moves,
                spare,
            )
            if made == 0:
                status, blamed = NOT_JOINED, left
                break
            firsts[index] = at
            at = expand(moves, made, out, at, edges[left])
    return status, blamed, keys, key_speeds, out[:at], firsts
