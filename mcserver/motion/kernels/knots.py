"""Find the zero-acceleration knots of a run from the speed limits that are exceeded without them.

See `mcserver.motion.profile.profile_solver`. A run of n groups of segments has n+1 edges along σ, the nodes,
each with a junction speed limit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.bottlenecks import mark_bottlenecks
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.phases import PHASE, PHASES_PER_MOVE, moves_to_phases, speeds_at
from mcserver.motion.kernels.ramp_kernels import (
    MAX_MOVES,
    MAX_TABLE_ROWS,
    MOVE,
    duration_of_moves,
    min_time_moves,
    reachable_speed_by_table,
)
from mcserver.motion.kernels.sample_limits import SLACK, Run, make_limit_table, min_limits
from mcserver.motion.kernels.timed_moves import KEPT, group_in_time

# Relative excess of the entry speed over the greatest speed from which the run can be planned. Profiles of a
# given duration reach their distance within 1e-8 and are stretched to it, which makes them that much faster
# than their knots. The step of velocity at such a knot is as large anyway.
ENTRY_ROUNDING = 2e-8

# Results of a search.
SOLVED, ENTRY_TOO_FAST, NOT_JOINED, TOO_MANY_ROUNDS = range(4)


class LimitTables(NamedTuple):
    """A cache of the acceleration-limit table of the stretch that begins at each knot.

    Attributes:
        rows: shape (n+1, `MAX_TABLE_ROWS`, 3). sizes: number of rows. right: the knot at the stretch's end.
    """

    rows: Array
    sizes: NDArray[np.intp]
    right: NDArray[np.intp]


MOST_PHASES = MAX_MOVES * PHASES_PER_MOVE


@compiled
def _moves_between(
    run: Run,
    tables: LimitTables,
    left: int,
    right: int,
    edges: Array,
    speeds: Array,
    moves: Array,
    spare: Array,
) -> int:
    """Write the moves between two knots without junction limits; return their number, 0 where none exist."""
    entry, exit_, distance = speeds[left], speeds[right], edges[right] - edges[left]
    made = min_time_moves(moves, spare, distance, entry, exit_, tables.rows[left], tables.sizes[left])
    if made == 0:
        # the knots' speeds were found with the lowest limits of the stretch: with these a profile exists
        one = np.empty((1, 3))
        one[0, 0] = max(entry, exit_, run.segment_vmax[left:right].min())
        one[0, 1], one[0, 2] = min_limits(run.free_at_vmax, left, right)
        made = min_time_moves(moves, spare, distance, entry, exit_, one, len(one))
    return made


@compiled
def _lowest_exceeded(
    left: int,
    right: int,
    edges: Array,
    junction_vmax: Array,
    segment_vmax: Array,
    phases: Array,
    count: int,
    speeds: Array,
) -> int:
    """Return the node to make a knot, at the lowest limit that the phases exceed; −1 without one."""
    origin = edges[left]
    speeds_at(phases, count, edges, origin, left + 1, right, speeds)
    worst, lowest = -1, math.inf
    for node in range(left + 1, right):
        if speeds[node] > junction_vmax[node] * SLACK and junction_vmax[node] < lowest:
            worst, lowest = node, junction_vmax[node]
    # speed rises to one peak and falls: in all groups but that of the peak it is greatest at an end
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
        if speed > segment_vmax[group] * SLACK and segment_vmax[group] < least:
            segment, least = group, segment_vmax[group]
    if segment >= 0 and least < lowest:
        # a group is limited by knots at both of its ends: choose the one that is not a knot yet
        worst = segment if segment > left else segment + 1
    return worst


@compiled
def _speeds_at_knots(
    run: Run,
    knots: NDArray[np.intp],
    edges: Array,
    junction_vmax: Array,
    tables: LimitTables,
    speeds: Array,
) -> None:
    """Write the greatest speeds at knots reachable from both neighbours, by a forward and a backward pass."""
    count = len(knots)
    for knot in knots:
        speeds[knot] = junction_vmax[knot]
    for index in range(count - 1):
        left, right = knots[index], knots[index + 1]
        if tables.right[left] != right:
            lower = min(junction_vmax[left], junction_vmax[right])
            tables.sizes[left] = make_limit_table(run, left, right, lower, tables.rows[left])
            tables.right[left] = right
    for direction in range(2):
        for step in range(count - 1):
            index = step if direction == 0 else count - 2 - step
            left, right = knots[index], knots[index + 1]
            other, knot = (left, right) if direction == 0 else (right, left)
            if speeds[knot] <= speeds[other]:
                continue
            distance = (edges[right] - edges[left]) * (1.0 - 1e-9)
            speeds[knot] = reachable_speed_by_table(
                speeds[other], distance, tables.rows[left], tables.sizes[left], speeds[knot]
            )


@compiled
def _phases_between_knots(
    run: Run,
    knots: NDArray[np.intp],
    edges: Array,
    durations: Array,
    tables: LimitTables,
    speeds: Array,
) -> tuple[int, Array, NDArray[np.intp], NDArray[np.intp]]:
    """Return the first group of a stretch that has no profile, −1 without one; and phases as `find_knots`."""
    moves, spare = np.empty((MAX_MOVES, MOVE)), np.empty((MAX_MOVES, MOVE))
    firsts = np.full(len(knots) - 1, -1, np.intp)
    timings = np.full(len(knots) - 1, KEPT, np.intp)
    phases = np.empty((MOST_PHASES * len(firsts), PHASE))
    at = 0
    for index in range(len(firsts)):
        left, right = knots[index], knots[index + 1]
        made = 0
        if not math.isnan(durations[left]):
            ends = (edges[right] - edges[left], speeds[left], speeds[right])
            made, timings[index] = group_in_time(moves, spare, run, left, ends, durations[left])
        if made == 0:
            made = _moves_between(run, tables, left, right, edges, speeds, moves, spare)
        if made == 0:
            return left, phases[:at], firsts, timings
        firsts[index] = at
        at = moves_to_phases(moves, made, phases, at, edges[left])
    return -1, phases[:at], firsts, timings


@compiled
def _split_slow_stretches(
    knots: NDArray[np.intp],
    speeds: Array,
    junction_vmax: Array,
    segment_vmax: Array,
    is_knot: NDArray[np.bool_],
) -> bool:
    """Add a knot at the slowest group of each stretch that limits the entry speed.

    Returns:
        False where each of these stretches is a single group.
    """
    found = False
    for index in range(len(knots) - 1):
        left, right = knots[index], knots[index + 1]
        if right - left > 1:
            slowest = left
            for group in range(left, right):
                if segment_vmax[group] < segment_vmax[slowest]:
                    slowest = group
            is_knot[min(max(slowest, left + 1), right - 1)] = True
            found = True
        if right == len(segment_vmax):
            break
        cap = min(junction_vmax[right], min(segment_vmax[right - 1], segment_vmax[right]))
        if speeds[right] >= cap * (1.0 - 1e-9):
            # stretches after this one do not limit the entry speed
            break
    return found


@compiled
def find_knots(
    run: Run,
    edges: Array,
    junction_vmax: Array,
    durations: Array,
    is_knot: NDArray[np.bool_],
    entry: float,
    required_only: bool,
) -> tuple[int, int, NDArray[np.intp], Array, Array, NDArray[np.intp], NDArray[np.intp]]:
    """Add knots until no stretch between two of them exceeds a speed limit, and return the phases.

    Each round adds a knot at the lowest limit that each stretch exceeds. Groups that are to take a T are
    between knots of their own.

    Args:
        durations: T of the groups that are to take one, else NaN, shape (n,) [s]. is_knot: initial knots,
            shape (n+1,), written.
        entry: speed at the beginning. required_only: no knots that only save time.

    Returns:
        The result and the group to blame; the knots and their speeds, shape (k,) each; the phases with σ
        counted from the run's start; for each stretch its first phase and its timing, `KEPT`, `LATE` or
        `EARLY`, shape (k-1,) each.
    """
    n = len(run.segment_vmax)
    segment_vmax = run.segment_vmax
    tables = LimitTables(
        np.empty((n + 1, MAX_TABLE_ROWS, 3)), np.zeros(n + 1, np.intp), np.full(n + 1, -1, np.intp)
    )
    # stretches that exceed no limit: the knot at their end, and the speeds at both knots
    settled = np.full((n + 1, 3), math.nan)
    new_knots = np.zeros(n + 1, np.bool_)
    moves, spare = np.empty((MAX_MOVES, MOVE)), np.empty((MAX_MOVES, MOVE))
    phases = np.empty((MOST_PHASES, PHASE))
    node_speeds = np.zeros(n + 1)
    speeds = np.zeros(n + 1)
    knots = np.nonzero(is_knot)[0]
    status, blamed = TOO_MANY_ROUNDS, 0
    for _ in range(4 * n + 8):
        _speeds_at_knots(run, knots, edges, junction_vmax, tables, speeds)
        if speeds[0] < entry * (1.0 - ENTRY_ROUNDING):
            # a stretch is assumed to have the acceleration of its slowest group throughout: shorter stretches
            # may allow the entry speed
            if not _split_slow_stretches(knots, speeds, junction_vmax, segment_vmax, is_knot):
                status = ENTRY_TOO_FAST
                break
            knots = np.nonzero(is_knot)[0]
            continue
        new_knots[:] = False
        for index in range(len(knots) - 1):
            left, right = knots[index], knots[index + 1]
            start, end = speeds[left], speeds[right]
            if right - left == 1:
                continue
            if settled[left, 0] == right and settled[left, 1] == start and settled[left, 2] == end:
                continue
            made = _moves_between(run, tables, left, right, edges, speeds, moves, spare)
            if made == 0:
                status, blamed = NOT_JOINED, left
                break
            written = moves_to_phases(moves, made, phases, 0, 0.0)
            node_speeds[left], node_speeds[right] = start, end
            worst = _lowest_exceeded(
                left, right, edges, junction_vmax, segment_vmax, phases, written, node_speeds
            )
            if worst >= 0:
                new_knots[worst] = True
            elif not required_only:
                duration = duration_of_moves(moves, made)
                mark_bottlenecks(run, left, right, edges, junction_vmax, speeds, duration, new_knots)
            settled[left, 0], settled[left, 1], settled[left, 2] = right, start, end
        if status == NOT_JOINED:
            break
        if not new_knots.any():
            status = SOLVED
            break
        is_knot |= new_knots
        knots = np.nonzero(is_knot)[0]
    if status != SOLVED:
        return status, blamed, knots, speeds[knots], phases[:0], knots[:0], knots[:0]
    unjoined, law, firsts, timings = _phases_between_knots(run, knots, edges, durations, tables, speeds)
    if unjoined >= 0:
        status, blamed = NOT_JOINED, unjoined
    return status, blamed, knots, speeds[knots], law, firsts, timings
