"""The search for a change of the playback rate that keeps the limits of all axes, within one cycle.

A change is tried on the very setpoints that it would give: their first, second and third differences are held
against the limits. Nothing is allocated or copied: rows are read where they stand in the ring, and a try ends
at the first setpoint that passes a limit. Time in cycles, u in rows.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.rate_changes import (
    CURVATURE,
    DURATION,
    MOST_PHASES,
    NEAR_U,
    RATE,
    SAME_RATE,
    SLOPE,
    add_phase,
    add_ramp,
    change_and_return,
    change_onto_rows,
    phase_advance,
    stop_at_edge,
    total_advance,
    total_time,
)
from mcserver.motion.kernels.row_interpolation import interpolate_rows, positions_between

# Shares of the limits that a change of rate is tried with, the fastest first: more of them find a faster
# change where rows leave little.
SHARES = (1.0, 0.85, 0.65, 0.4, 0.2, 0.08)
# Rates that a change may go to with each share: what is asked for, what the next rows allow, the present one,
# 100 %.
GOALS = 4
# Where a stop has to end on an edge, shares of the rate that are kept until then: where rows brake before the
# edge with all that an axis has, only who is slow by then can stop on it.
NEAR_GOALS = (1.0, 0.6, 0.3, 0.1)
TRIES = GOALS * len(SHARES)
# What is looked at in one cycle before the search goes on in the next one, counted in setpoints of one axis,
# some 5 ns each: a change is tried as a whole, so one more may be begun below this. Each cycle of a change
# costs as much as some axes, and each try as much as some cycles.
BUDGET, CYCLE_COST, TRY_COST = 10_000, 6, 100
# Cycles of steady rate at a plan's end, in which the third difference settles.
SETTLING = 3
# Cycles that a rate above 100 % is kept before it is looked at again: fewer follow the rows' limits more
# closely, and cost more.
CRUISE = 12
# Largest slope of the rate, where axes hardly move [1/cycle].
MAX_SLOPE = 0.5
# What an axis may move in a cycle on an edge on which its rows are at rest [m, rad].
AT_REST = 1e-12
# A rate above 100 % is not tried for less than this [1].
WORTH = 0.01
# A steady rate of 100 % or less keeps the limits wherever rows do: of a long one only this many cycles at
# either end are looked at.
STEADY_ENDS = 6
# Rows that setpoints about a row span, before it and after it.
SPAN_BEFORE, SPAN_AFTER = 6, 1

# Columns of the state that is asked about: u, the rate and its slope; the rate that is wished for, and the u
# before which the motion has to be able to stop (infinite: none); the rows that the longest stop takes; the
# first cycle's length [s]; u where the motion began.
U, NOW, BEND, TARGET, EDGE, FAR, SECONDS, BEGUN = range(8)
STATE = 8
# Rows of the limits of each axis: the greatest differences of its setpoints, the same for what a change of
# rate is made with, and the accelerations of interpolation.
VELOCITY, ACCELERATION, JERK, RAW_ACCELERATION, RAW_JERK, MOST = range(6)
# Rows of the scratch for each axis: limits of this search, speed, and the last setpoint and its differences.
_LIMIT, _SPEED, _SETPOINT, _FIRST, _SECOND, _PLACE, _STILL = 0, 3, 4, 5, 6, 7, 8
SCRATCH = 9


@compiled
def headroom_ahead(headroom: Array, first: int, count: int) -> float:
    """Return the greatest rate that some rows allow by themselves.

    Args:
        headroom: of the ring, shape (n,). first: number of the first row.
    """
    least = math.inf
    for number in range(first, first + count):
        least = min(least, headroom[number % len(headroom)])
    return least


@compiled
def _find_window(
    row_u: NDArray[np.int64],
    first: int,
    last: int,
    from_rest: bool,
    begun: float,
    places: Array,
    at: NDArray[np.int64],
) -> int:
    """Write u and the place in the ring of rows first to last - 1, and where the axes rest between them.

    From where a motion stands at its beginning, or after a gap, to the next row it goes from rest: such a
    place is noted as -1 - (the row it rests at), that of the beginning as -1 - n.

    Returns:
        The number of places.
    """
    size = len(row_u)
    count = 0
    for number in range(first, last):
        here = float(row_u[number % size])
        if number == first and from_rest:
            places[0] = min(max(here - 1.0, begun), here - NEAR_U)
            at[0] = -1 - size
            count = 1
        elif number > first and here - places[count - 1] > 1.0 + NEAR_U:
            # at rest until a cycle before the next row
            places[count] = here - 1.0
            at[count] = -1 - (number - 1) % size
            count += 1
        places[count] = here
        at[count] = number % size
        count += 1
    return count


@compiled
def _row_position(position: Array, start: Array, at: int) -> Array:
    """Return the positions at a place of the window."""
    row = start
    if at >= 0:
        row = position[at]
    elif -1 - at < len(position):
        row = position[-1 - at]
    return row


@compiled
def _row_velocity(velocity: Array, still: Array, at: int) -> Array:
    """Return the velocities at a place of the window."""
    row = still
    if at >= 0:
        row = velocity[at]
    return row


@compiled
def _set_limits(
    velocity: Array,
    limits: Array,
    driven: NDArray[np.bool_],
    displaced: NDArray[np.bool_],
    first: int,
    last: int,
    urgent: bool,
    scratch: Array,
) -> None:
    """Write what the setpoints' differences may be: infinite for axes that do not move in the window."""
    width, size = velocity.shape[1], len(velocity)
    moving = 0
    wanted = 0
    for k in range(width):
        scratch[_LIMIT, k] = math.inf
        wanted += driven[k]
        if driven[k] and displaced[k]:
            scratch[_LIMIT, k] = 0.0
            moving += 1
    for number in range(first, last):
        if moving == wanted:
            break
        row = velocity[number % size]
        for k in range(width):
            if row[k] != 0.0 and driven[k] and scratch[_LIMIT, k] != 0.0:
                scratch[_LIMIT, k] = 0.0
                moving += 1
    for k in range(width):
        moves = scratch[_LIMIT, k] == 0.0
        for order in range(3):
            scratch[_LIMIT + order, k] = limits[VELOCITY + order, k] if moves else math.inf
        if urgent:
            scratch[_LIMIT + 2, k] = math.inf


@compiled
def _straight_limits(
    velocity: Array,
    places: Array,
    at: NDArray[np.int64],
    count: int,
    limits: Array,
    scratch: Array,
    state: Array,
    change: float,
    fastest: float,
) -> tuple[float, float]:
    """Return the largest slope and curvature of the rate over the rows that a change passes, were they
    straight.

    Args:
        change: of the rate [1]. fastest: rate on the way [1].
    """
    u, seconds = state[U], state[SECONDS]
    width = velocity.shape[1]
    speed, still = scratch[_SPEED], scratch[_STILL]
    reach = 16.0
    slope = curvature = math.inf
    for _ in range(2):
        for k in range(width):
            speed[k] = 0.0
        for i in range(count):
            if u - 1.0 <= places[i] <= u + reach:
                row = _row_velocity(velocity, still, at[i])
                for k in range(width):
                    here = abs(row[k])
                    speed[k] = here if here > speed[k] else speed[k]
        slope, curvature = MAX_SLOPE, math.inf
        for k in range(width):
            if math.isinf(scratch[_LIMIT, k]):
                continue
            moved = speed[k] * seconds + 1e-30
            slope = min(slope, limits[RAW_ACCELERATION, k] / moved)
            curvature = min(curvature, limits[RAW_JERK, k] / moved)
        if not math.isinf(curvature):
            curvature = min(curvature, MAX_SLOPE)
        reach = (change / slope + slope / curvature) * fastest + 4.0
    return slope, curvature


@compiled
def _own_difference(
    position: Array, start: Array, at: NDArray[np.int64], row: int, k: int, order: int
) -> float:
    """Return the absolute difference of the rows of one axis that ends at a row, 0 where one is lacking."""
    if row < order:
        return 0.0
    p0 = float(_row_position(position, start, at[row])[k])
    p1 = float(_row_position(position, start, at[row - 1])[k])
    if order == 1:
        return abs(p0 - p1)
    p2 = float(_row_position(position, start, at[row - 2])[k])
    if order == 2:
        return abs(p0 - 2.0 * p1 + p2)
    p3 = _row_position(position, start, at[row - 3])[k]
    return float(abs((p0 - p3) - 3.0 * (p1 - p2)))


@compiled
def _share_of_limit(
    position: Array,
    start: Array,
    at: NDArray[np.int64],
    count: int,
    row: int,
    k: int,
    order: int,
    here: float,
    limit: float,
) -> float:
    """Return a difference in shares of what it may be: what rows about it do themselves is allowed."""
    allowed = limit
    for near in range(max(row - SPAN_BEFORE, 0), min(row + SPAN_AFTER, count - 1) + 1):
        allowed = max(allowed, _own_difference(position, start, at, near, k, order))
    return here / allowed


@compiled
def _excess(
    position: Array,
    velocity: Array,
    start: Array,
    places: Array,
    at: NDArray[np.int64],
    count: int,
    ends: bool,
    recent: Array,
    limits: Array,
    scratch: Array,
    state: Array,
    phases: Array,
    parts: int,
    target: float,
    give_up: float,
) -> tuple[float, int]:
    """Try a plan on its setpoints.

    Args:
        recent: the setpoints of the last three cycles, the newest last, shape (3, K). phases, parts: the
            plan. target: its steady rate at the end. give_up: excess from which on the try may end.

    Returns:
        By what the setpoints pass the limits at the worst, 1 within them; infinite: never to be driven. And
        the number of setpoints looked at.
    """
    u, edge = state[U], state[EDGE]
    width = position.shape[1]
    duration = total_time(phases, parts)
    cycles = math.ceil(duration - 1e-9) + SETTLING
    passed = total_advance(phases, parts)
    end = u + passed + (cycles - duration) * target
    if end > edge + 1e-6:
        return math.inf, 0
    if target > 0.0 and edge - end < state[FAR]:
        # nothing is looked for while a plan is followed: behind it there has to be room for a stop
        return math.inf, 0
    if end > places[count - 1] + 1e-6 and not ends:
        return math.inf, 0
    last, now = scratch[_SETPOINT], scratch[_PLACE]
    first, second, still = scratch[_FIRST], scratch[_SECOND], scratch[_STILL]
    for k in range(width):
        last[k] = recent[2, k]
        first[k] = recent[2, k] - recent[1, k]
        second[k] = first[k] - (recent[1, k] - recent[0, k])
    worst, looked, blind = 1.0, 0, 0
    part, begun, before, row = 0, 0.0, 0.0, 0
    cycle = 1
    while cycle <= cycles:
        while part < parts and cycle > begun + phases[part, DURATION]:
            before += phase_advance(phases[part], phases[part, DURATION])
            begun += phases[part, DURATION]
            part += 1
        t = cycle - begun
        if part < parts:
            steady = (
                phases[part, SLOPE] == 0.0 and phases[part, CURVATURE] == 0.0 and phases[part, RATE] <= 1.0
            )
            until = math.floor(begun + phases[part, DURATION]) - STEADY_ENDS
            if steady and t > STEADY_ENDS and until > cycle + STEADY_ENDS:
                # the differences are found anew in three cycles
                cycle, blind = until, 3
                t = cycle - begun
            moved = before + phase_advance(phases[part], t)
            rate = phases[part, RATE] + t * (phases[part, SLOPE] + t * phases[part, CURVATURE] / 2.0)
        else:
            moved, rate = before + t * target, target
        if rate < -1e-9 or (cycle == 1 and moved < -1e-9):
            return math.inf, looked
        here = u + moved
        while row < count and places[row] <= here:
            row += 1
        while row > 0 and places[row - 1] > here:
            row -= 1
        # the interval is that before the first row behind, the last one beyond them all
        low = min(max(row - 1, 0), max(count - 2, 0))
        high = min(low + 1, count - 1)
        span = places[high] - places[low] if high > low else 1.0
        share = min(max((here - places[low]) / span, 0.0), 1.0)
        positions_between(
            _row_position(position, start, at[low]),
            _row_position(position, start, at[high]),
            _row_velocity(velocity, still, at[low]),
            _row_velocity(velocity, still, at[high]),
            share if high > low else 0.0,
            span * state[SECONDS],
            limits[MOST],
            now,
        )
        looked += width + CYCLE_COST
        passes = 0
        for k in range(width):
            one = now[k] - last[k]
            two = one - first[k]
            three = two - second[k]
            last[k], first[k], second[k] = now[k], one, two
            now[k] = three
            passes |= (abs(one) > scratch[_LIMIT, k]) | (abs(two) > scratch[_LIMIT + 1, k])
            passes |= abs(three) > scratch[_LIMIT + 2, k]
        if blind > 0:
            blind -= 1
        elif passes:
            about = min(row, count - 1)
            for k in range(width):
                for order in range(3):
                    size = abs(first[k]) if order == 0 else (abs(second[k]) if order == 1 else abs(now[k]))
                    limit = scratch[_LIMIT + order, k]
                    if size > limit:
                        over = _share_of_limit(position, start, at, count, about, k, order + 1, size, limit)
                        worst = max(worst, over)
            looked += width
            if worst > give_up:
                return worst, looked
        cycle += 1
    return worst, looked


@compiled
def _rests_at(
    velocity: Array, places: Array, at: NDArray[np.int64], count: int, scratch: Array, state: Array
) -> bool:
    """Return whether the rows come to rest by themselves on the edge."""
    found = False
    for i in range(count):
        if abs(places[i] - state[EDGE]) < NEAR_U:
            found = True
            row = _row_velocity(velocity, scratch[_STILL], at[i])
            for k in range(len(row)):
                if not math.isinf(scratch[_LIMIT, k]) and abs(row[k]) * state[SECONDS] > AT_REST:
                    return False
    return found


@compiled
def _candidate(
    which: int,
    state: Array,
    near: bool,
    planned: bool,
    cap: float,
    slope: float,
    curvature: float,
    phases: Array,
) -> tuple[int, float]:
    """Write one of the changes that are worth a try.

    Args:
        which: of `GOALS`. near: a stop before the edge may have to begin soon. planned: a plan is followed.
            cap: the greatest rate that the next rows allow. slope, curvature: limits of the rate.

    Returns:
        The number of its phases, below 0: none; and its steady rate at the end.
    """
    u, rate, bend, target = state[U], state[NOW], state[BEND], state[TARGET]
    if near:
        room, goal = state[EDGE] - u, min(target, 1.0) * NEAR_GOALS[which]
        return stop_at_edge(phases, room, rate, bend, goal, slope, curvature), 0.0
    if target <= 1.0:
        if which > 0:
            return -1, 0.0
        if target == 1.0:
            return change_onto_rows(phases, u, rate, bend, 1.0, slope, curvature), 1.0
        return add_ramp(phases, 0, rate, bend, target, slope, curvature), target
    if which == 3:
        if planned or abs(rate - 1.0) <= SAME_RATE:
            return -1, 1.0
        return change_onto_rows(phases, u, rate, bend, 1.0, slope, curvature), 1.0
    capped = min(target, cap)
    goal = target if which == 0 else (capped if which == 1 else rate)
    tried = (which >= 1 and abs(goal - target) <= WORTH) or (
        which == 2 and capped > 1.0 + WORTH and abs(goal - capped) <= WORTH
    )
    if goal <= 1.0 + WORTH or tried:
        return -1, 1.0
    return change_and_return(phases, rate, bend, goal, float(CRUISE), slope, curvature), 1.0


@compiled
def search_rate(
    row_u: NDArray[np.int64],
    position: Array,
    velocity: Array,
    headroom: Array,
    numbers: NDArray[np.int64],
    flags: NDArray[np.bool_],
    driven: NDArray[np.bool_],
    displaced: NDArray[np.bool_],
    start: Array,
    recent: Array,
    limits: Array,
    state: Array,
    from_try: int,
    places: Array,
    at: NDArray[np.int64],
    scratch: Array,
    phases: Array,
    spare: Array,
) -> tuple[int, float, int, float, int]:
    """Find the fastest change of the rate that keeps all limits, as far as this cycle's budget goes.

    Args:
        row_u, position, velocity, headroom: of the ring, shape (n,) or (n, K).
        numbers: of the window's first row, the row after u, the row after the window's last, the row after
            all there are, and the program's first row.
        flags: the motion goes from rest to the window's first row, the last row is its own end, no regard to
            jerk, a plan is followed, a plan that passes the limits is wanted too.
        driven: axes, shape (K,). displaced: those that are not where their motion began, shape (K,).
        start: positions where the motion began, shape (K,). recent: setpoints of the last three cycles, the
            newest last, shape (3, K). limits: shape (6, K). state: shape (`STATE`,).
        from_try: of `TRIES`, the first one.
        places, at: shape (2 n + 2,). scratch: shape (`SCRATCH`, K), its last row 0.
        phases, spare: shape (`MOST_PHASES`, 4), written: the change, and the one that passes limits least.

    Returns:
        Phases of the change (below 0: none found) and its steady rate at the end, the same of the spare one,
        and the number of tries, one that was left out included.
    """
    first, following, behind, written = numbers[0], numbers[1], numbers[2], numbers[3]
    from_rest, ends, urgent, planned, any_wanted = flags[0], flags[1], flags[2], flags[3], flags[4]
    u, rate, target, edge = state[U], state[NOW], state[TARGET], state[EDGE]
    count = _find_window(row_u, first, behind, from_rest, state[BEGUN], places, at)
    _set_limits(velocity, limits, driven, displaced, first, behind, urgent, scratch)
    near = edge - u < state[FAR] * max(1.0, rate)
    keeps = near and state[BEND] == 0.0 and 0.0 < rate <= target
    if keeps and _rests_at(velocity, places, at, count, scratch, state):
        # at this rate to an edge on which the rows come to rest by themselves
        parts = add_phase(phases, 0, (edge - u) / rate, rate, 0.0, 0.0)
        over, _ = _excess(
            position, velocity, start, places, at, count, ends, recent, limits, scratch, state,
            phases, parts, 0.0, 1.0,
        )  # fmt: skip
        if over <= 1.0:
            return parts, 0.0, -1, 0.0, 0
    change = max(abs(target - rate), 0.1)
    if near:
        change = max(rate, min(target, 1.0))
    slope, curvature = _straight_limits(
        velocity, places, at, count, limits, scratch, state, change, max(rate, target)
    )
    if urgent:
        curvature = math.inf
    beginning = max(following - 1, numbers[4])
    cap = 1.0
    if target > 1.0 and beginning < written:
        cap = headroom_ahead(headroom, beginning, min(2 * CRUISE + 9, written - beginning))
    least, spare_parts, spare_target = math.inf, -1, 0.0
    looked, tried = 0, 0
    while tried < TRIES and looked < BUDGET:
        number = (from_try + tried) % TRIES
        # before an edge a gentle stop is better than an early one
        which = number // len(SHARES) if near else number % GOALS
        share = SHARES[number % len(SHARES) if near else number // GOALS]
        parts, end = _candidate(which, state, near, planned, cap, slope * share, curvature * share, phases)
        tried += 1
        if parts < 0:
            continue
        give_up = max(1.0, least) if any_wanted else 1.0
        over, seen = _excess(
            position, velocity, start, places, at, count, ends, recent, limits, scratch, state,
            phases, parts, end, give_up,
        )  # fmt: skip
        looked += seen + TRY_COST
        if over <= 1.0:
            return parts, end, spare_parts, spare_target, tried
        if any_wanted and over < least:
            least, spare_parts, spare_target = over, parts, end
            for i in range(parts):
                for j in range(phases.shape[1]):
                    spare[i, j] = phases[i, j]
    return -1, 0.0, spare_parts, spare_target, tried


def warm_up_playback() -> None:
    """Compile what the executor calls, or read it from the cache: before it is on time for anything."""
    width, size = 1, 4
    rows, limits, scratch = np.zeros((size, width)), np.ones((6, width)), np.zeros((SCRATCH, width))
    some, state = np.ones(width, np.bool_), np.ones(STATE)
    phases = np.zeros((MOST_PHASES, 4))
    places, at = np.zeros(2 * size + 2), np.zeros(2 * size + 2, np.int64)
    numbers, flags = np.array([0, 1, size, size, 0]), np.zeros(5, np.bool_)
    search_rate(
        np.arange(size), rows, rows, np.ones(size), numbers, flags, some, some, rows[0], rows[:3], limits,
        state, 0, places, at, scratch, phases, phases.copy(),
    )  # fmt: skip
    headroom_ahead(np.ones(size), 0, size)
    interpolate_rows(rows, rows, 0, 1, 0.5, 1e-3, 1.0, rows[0], some, rows[2], rows[3])
