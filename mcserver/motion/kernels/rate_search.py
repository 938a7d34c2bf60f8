"""The search for a change of the playback rate that keeps the limits of all axes, within one cycle.

A change is tried on the very setpoints that it would give (`rate_trial.py`); nothing is allocated or copied.
Time in cycles, u in rows.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.row_torques import NUMBERS
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.envelope import find_excess, find_tip_outside, find_wrong_row, tip_positions
from mcserver.motion.kernels.rate_changes import (
    MOST_PHASES,
    NEXT_RATE,
    SAME_RATE,
    add_phase,
    add_ramp,
    change_and_keep,
    change_and_return,
    change_onto_rows,
    stop_at_edge,
)
from mcserver.motion.kernels.rate_trial import excess
from mcserver.motion.kernels.rate_window import (
    BEGUN,
    BEND,
    EDGE,
    FAR,
    HIGHER,
    HIGHER_FROM,
    LIMIT,
    LIMITS,
    NOW,
    RAW_ACCELERATION,
    RAW_JERK,
    SAFE,
    SCRATCH,
    SECONDS,
    SPEED,
    STATE,
    STILL,
    TARGET,
    U,
    find_window,
    rests_at,
    row_velocity,
    set_limits,
)
from mcserver.motion.kernels.row_interpolation import interpolate_rows
from mcserver.motion.kernels.row_torques import change_limit

# Shares of the limits that a change of rate is tried with, the fastest first: more of them find a faster
# change where rows leave little.
SHARES = (1.0, 0.85, 0.65, 0.4, 0.2, 0.08)
# Rates that a change may go to with each share: what is asked for, what the next rows allow, half of the way
# there, the present one, the safe one. Where a higher rate is safe soon, the first keeps what is asked for,
# if that is no more, and the fourth the present one.
GOALS = 5
# So many of them come before the others, the largest share first: a rate that is kept is always to be had,
# and would keep a gentle rise from being tried.
RISING = 3
# Where a stop has to end on an edge, shares of the rate that are kept until then: where rows brake before the
# edge with all that an axis has, only who is slow by then can stop on it.
NEAR_GOALS = (1.0, 0.6, 0.3, 0.1, 0.03)
TRIES = GOALS * len(SHARES)
# Parts of a change, and the shares of the limits that each is tried with, the largest first: rows that use
# all of a torque leave it only bit by bit, since what the motion asks for falls with the square of the rate,
# and so do rows that use all of a jerk. Beyond those of a whole change, so the number of tries is the same.
PARTIAL = (
    (0.5, 0.65), (0.5, 0.2), (0.5, 0.08), (0.2, 0.4), (0.2, 0.2), (0.2, 0.08), (0.2, 0.03), (0.06, 0.2),
    (0.06, 0.08), (0.06, 0.03), (0.06, 0.01), (0.02, 0.08), (0.02, 0.03), (0.02, 0.01), (0.06, 0.003),
    (0.02, 0.003),
)  # fmt: skip
# A smaller change is not made in parts [1].
LEAST_PART = 0.01
# Motion that stands begins with time stretched by powers of this where no change of full pace keeps the
# limits: at a rate lower by g, with a slope lower by g² and a curvature lower by g³, velocity, acceleration
# and jerk of whatever the rows do fall with g, g² and g³. So many powers: slower ones take long to try.
SLOWER, SLOWEST = 0.82, 18
# What is looked at in one cycle before the search goes on in the next one, counted in setpoints of one axis,
# some 5 ns each: a change is tried as a whole, so one more may be begun below this. Each try costs as much as
# some cycles.
BUDGET, TRY_COST = 10_000, 100
# Cycles that a rate above the safe one is kept before it is looked at again: fewer follow the rows' limits
# more closely, and cost more.
CRUISE = 12
# Largest slope of the rate, where axes hardly move [1/cycle].
MAX_SLOPE = 0.5
# A rate above the safe one is not tried for less than this [1].
WORTH = 0.01


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
def safe_rates(
    pace: Array, velocity: Array, row_u: NDArray[np.int64], first: int, behind: int, until: float
) -> tuple[float, float, float]:
    """Return the rate at which all rows ahead may be played, and what is safe beyond some of them.

    Behind a row at rest motion may go on at any other pace.

    Args:
        pace, velocity, row_u: of the ring, shape (n,) or (n, K). first, behind: numbers of the first row and
            of that after the last. until: greatest u from which on a higher rate is looked for.

    Returns:
        The safe rate, the u from which on a higher one is safe (infinite: none), and that.
    """
    size = len(pace)
    safe, higher, since, after = 1.0 if behind <= first else math.inf, 1.0, math.inf, -1.0
    for number in range(behind - 1, first - 1, -1):
        here = pace[number % size]
        if here != after and not math.isinf(safe) and (velocity[number % size] == 0.0).all():
            safe, since = math.inf, math.inf
        after = here
        if here < safe:
            if math.isinf(since) and not math.isinf(safe) and row_u[number % size] <= until:
                since, higher = float(row_u[number % size]), safe
            safe = here
    return safe, since, higher


@compiled
def _straight_limits(
    velocity: Array,
    torque: Array,
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
    speed, still = scratch[SPEED], scratch[STILL]
    reach = 16.0
    slope = curvature = math.inf
    for _ in range(2):
        for k in range(width):
            speed[k] = 0.0
        for i in range(count):
            if u - 1.0 <= places[i] <= u + reach:
                row = row_velocity(velocity, still, at[i])
                for k in range(width):
                    here = abs(row[k])
                    speed[k] = here if here > speed[k] else speed[k]
        slope, curvature = MAX_SLOPE, math.inf
        if torque.shape[2] > 0:
            for i in range(count):
                if at[i] >= 0 and u - 1.0 <= places[i] <= u + reach:
                    slope = min(slope, change_limit(torque, at[i]))
        for k in range(width):
            if math.isinf(scratch[LIMIT, k]):
                continue
            moved = speed[k] * seconds + 1e-30
            slope = min(slope, limits[RAW_ACCELERATION, k] / moved)
            curvature = min(curvature, limits[RAW_JERK, k] / moved)
        if not math.isinf(curvature):
            curvature = min(curvature, MAX_SLOPE)
        reach = (change / slope + slope / curvature) * fastest + 4.0
    return slope, curvature


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
    u, rate, bend, target, safe = state[U], state[NOW], state[BEND], state[TARGET], state[SAFE]
    if near:
        room, goal = state[EDGE] - u, min(target, safe) * NEAR_GOALS[which]
        if target < min(rate, safe) and which > 0:
            # rows that leave nothing to a slower rate now may leave it later
            goal = max(min(rate, safe) * NEAR_GOALS[which - 1], target)
        return stop_at_edge(phases, room, rate, bend, goal, slope, curvature), 0.0
    if target <= safe:
        if which > 0:
            return -1, 0.0
        return _change(phases, u, rate, bend, target, slope, curvature), target
    if which == 4:
        if planned or abs(rate - safe) <= SAME_RATE:
            return -1, safe
        return _change(phases, u, rate, bend, safe, slope, curvature), safe
    higher = not math.isinf(state[HIGHER_FROM])
    if higher and (which == 3 or (which == 0 and target <= state[HIGHER] + WORTH)):
        goal = min(target if which == 0 else min(rate, target), state[HIGHER])
        if which == 3 and goal < safe + WORTH:
            return -1, safe
        return change_and_keep(phases, state[HIGHER_FROM] - u, rate, bend, goal, slope, curvature), goal
    capped = min(target, cap)
    goal = target
    if which == 1:
        goal = capped
    elif which == 2:
        goal = 0.5 * (max(rate, safe) + capped)
    elif which == 3:
        # no more is kept than is wished for
        goal = min(rate, target)
    tried = (which >= 1 and abs(goal - target) <= WORTH) or (
        which >= 2 and capped > safe + WORTH and abs(goal - capped) <= WORTH
    )
    if goal <= safe + WORTH or tried or (which in (1, 2) and goal < rate + WORTH):
        return -1, safe
    return change_and_return(phases, u, rate, bend, goal, float(CRUISE), safe, slope, curvature), safe


@compiled
def _change(
    phases: Array, u: float, rate: float, bend: float, target: float, slope: float, curvature: float
) -> int:
    """Write the change to a safe rate, onto whole rows where that is a whole one; return how many phases."""
    if target > 0.0 and target == round(target):
        return change_onto_rows(phases, u, rate, bend, target, slope, curvature)
    return add_ramp(phases, 0, rate, bend, target, slope, curvature)


@compiled
def _partial(number: int, state: Array, slope: float, curvature: float, phases: Array) -> tuple[int, float]:
    """Write one of the changes to a safe rate that are worth a try where torques are limited.

    Args:
        number: of `TRIES`: the whole change first, the faster the earlier, then ever smaller parts of it.

    Returns:
        As of `_candidate`.
    """
    u, rate, bend, target = state[U], state[NOW], state[BEND], state[TARGET]
    if number < len(SHARES):
        share = SHARES[number]
        return _change(phases, u, rate, bend, target, slope * share, curvature * share), target
    if number - len(SHARES) >= len(PARTIAL) or abs(target - rate) < LEAST_PART:
        return -1, 0.0
    part, share = PARTIAL[number - len(SHARES)]
    goal = rate + part * (target - rate)
    near = target * NEXT_RATE
    if target == round(target) and rate < target and goal > near:
        # nearer to a whole rate u would not meet the rows in a moment any more
        goal = near if rate < near else target
    if goal > state[SAFE]:
        # no plan ends where rows cannot be played on for ever
        return -1, 0.0
    if goal == target:
        return _change(phases, u, rate, bend, target, slope * share, curvature * share), target
    return add_ramp(phases, 0, rate, bend, goal, slope * share, curvature * share), goal


@compiled
def _slow_change(
    number: int, state: Array, near: bool, slope: float, curvature: float, phases: Array
) -> tuple[int, float]:
    """Write a change from rest, or before an edge, whose time is stretched.

    Args:
        number: of `TRIES`, the quickest first. near: the motion has to stop before the edge.

    Returns:
        As of `_candidate`.
    """
    rate, bend = state[NOW], state[BEND]
    if number >= SLOWEST:
        return -1, 0.0
    goal = (rate if rate > 0.0 else min(state[TARGET], state[SAFE]) * SLOWER) * SLOWER**number
    slope, curvature = slope * goal**2, curvature * goal**3
    if near:
        return stop_at_edge(phases, state[EDGE] - state[U], rate, bend, goal, slope, curvature), 0.0
    return add_ramp(phases, 0, rate, bend, goal, slope, curvature), goal


@compiled
def search_rate(
    row_u: NDArray[np.int64],
    position: Array,
    velocity: Array,
    torque: Array,
    headroom: Array,
    pace: Array,
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
        row_u, position, velocity, torque, headroom, pace: of the ring, shape (n,), (n, K), or (n, 3, J) for J
            joints whose torques are limited; none are where jerk is not to be regarded.
        numbers: of the window's first row, the row after u, the row after the window's last, the row after
            all there are, and the program's first row.
        flags: the motion goes from rest to the window's first row, the last row is its own end, no regard to
            jerk, a plan is followed, a plan that passes the limits is wanted too, time may be stretched,
            a change may go a part of the way.
        driven: axes, shape (K,). displaced: those that are not where their motion began, shape (K,).
        start: positions where the motion began, shape (K,). recent: setpoints of the last three cycles, the
            newest last, shape (3, K). limits: shape (`LIMITS`, K). state: shape (`STATE`,).
        from_try: of `TRIES`, the first one.
        places, at: shape (2 n + 2,). scratch: shape (`SCRATCH`, K), its last row 0.
        phases, spare: shape (`MOST_PHASES`, 4), written: the change, and the one that passes limits least.

    Returns:
        Phases of the change (below 0: none found) and its steady rate at the end, the same of the spare one,
        and the number of tries, one that was left out included.
    """
    first, following, behind, written = numbers[0], numbers[1], numbers[2], numbers[3]
    from_rest, ends, urgent, planned, any_wanted = flags[0], flags[1], flags[2], flags[3], flags[4]
    slowly, in_parts = flags[5], flags[6]
    u, rate, target, edge, safe = state[U], state[NOW], state[TARGET], state[EDGE], state[SAFE]
    count, waits = find_window(
        row_u, position, velocity, first, behind, from_rest, state[BEGUN], driven, limits, state[SECONDS],
        places, at,
    )  # fmt: skip
    ends = ends or waits
    set_limits(velocity, limits, driven, displaced, first, behind, urgent, scratch)
    near = edge - u < state[FAR] * max(1.0, rate)
    keeps = near and state[BEND] == 0.0 and 0.0 < rate <= target
    if keeps and rests_at(velocity, places, at, count, scratch, state):
        # at this rate to an edge on which the rows come to rest by themselves
        parts = add_phase(phases, 0, (edge - u) / rate, rate, 0.0, 0.0)
        over, _ = excess(
            position, velocity, torque, pace, start, places, at, count, ends, recent, limits, scratch, state,
            phases, parts, 0.0, 1.0,
        )  # fmt: skip
        if over <= 1.0:
            return parts, 0.0, -1, 0.0, 0
    change = max(abs(target - rate), 0.1)
    if near:
        change = max(rate, min(target, safe))
    slope, curvature = _straight_limits(
        velocity, torque, places, at, count, limits, scratch, state, change, max(rate, target)
    )
    if urgent:
        curvature = math.inf
    beginning = max(following - 1, numbers[4])
    cap = safe
    if target > safe and beginning < written:
        cap = headroom_ahead(headroom, beginning, min(2 * CRUISE + 9, written - beginning))
    least, spare_parts, spare_target = math.inf, -1, 0.0
    looked, tried = 0, 0
    while tried < TRIES and looked < BUDGET:
        number = (from_try + tried) % TRIES
        # before an edge a gentle stop is better than an early one
        which, share = number // len(SHARES), SHARES[number % len(SHARES)]
        if not near and number < RISING * len(SHARES):
            which, share = number % RISING, SHARES[number // RISING]
        if slowly:
            parts, end = _slow_change(number, state, near, slope, curvature, phases)
        elif in_parts and not near and target <= safe:
            parts, end = _partial(number, state, slope, curvature, phases)
        else:
            parts, end = _candidate(
                which, state, near, planned, cap, slope * share, curvature * share, phases
            )
        tried += 1
        if parts < 0:
            continue
        give_up = max(1.0, least) if any_wanted else 1.0
        over, seen = excess(
            position, velocity, torque, pace, start, places, at, count, ends, recent, limits, scratch, state,
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
    rows, limits, scratch = np.zeros((size, width)), np.ones((LIMITS, width)), np.zeros((SCRATCH, width))
    some, state = np.ones(width, np.bool_), np.ones(STATE)
    phases = np.zeros((MOST_PHASES, 4))
    places, at = np.zeros(2 * size + 2), np.zeros(2 * size + 2, np.int64)
    numbers, flags = np.array([0, 1, size, size, 0]), np.zeros(7, np.bool_)
    search_rate(
        np.arange(size), rows, rows, np.zeros((size, NUMBERS, 1)), np.ones(size), np.ones(size), numbers,
        flags, some, some, rows[0], rows[:3], limits,
        state, 0, places, at, scratch, phases, phases.copy(),
    )  # fmt: skip
    headroom_ahead(np.ones(size), 0, size)
    safe_rates(np.ones(size), rows, np.arange(size), 0, size, 0.0)
    interpolate_rows(rows, rows, 0, 1, 0.5, 1e-3, 1.0, 1.0, rows[:2], some, rows[2], rows[3])
    find_wrong_row(
        rows,
        rows,
        np.zeros(size, np.uint64),
        rows[:, 0].copy(),
        np.ones(size),
        0,
        1,
        rows[0],
        rows[1],
        rows[2],
    )
    find_excess(rows[0], rows[1], rows[2], rows[3], rows[0], 1.0, some, some)
    masks, zero = np.zeros(size, np.uint64), np.zeros(1, np.intp)
    tip_positions(np.zeros((2, 3, 4)), some, rows[:1])
    find_tip_outside(np.zeros((2, 3, 4)), some, zero, rows, masks, rows[0], 0, 1, np.zeros(3), np.zeros(3))


@compiled
def keeps_limits(
    row_u: NDArray[np.int64],
    position: Array,
    velocity: Array,
    torque: Array,
    pace: Array,
    numbers: NDArray[np.int64],
    flags: NDArray[np.bool_],
    driven: NDArray[np.bool_],
    displaced: NDArray[np.bool_],
    start: Array,
    recent: Array,
    limits: Array,
    state: Array,
    places: Array,
    at: NDArray[np.int64],
    scratch: Array,
    phases: Array,
    parts: int,
) -> bool:
    """Return whether the next setpoints keep all limits with those before.

    Args:
        As of `search_rate`; of the numbers the first and the third count, of the flags the first two.
        phases, parts: the change of the rate to the steady one, `TARGET`; none: at that from now on.
    """
    first, behind = numbers[0], numbers[2]
    count, waits = find_window(
        row_u, position, velocity, first, behind, flags[0], state[BEGUN], driven, limits, state[SECONDS],
        places, at,
    )  # fmt: skip
    set_limits(velocity, limits, driven, displaced, first, behind, False, scratch)
    over, _ = excess(
        position, velocity, torque, pace, start, places, at, count, flags[1] or waits, recent, limits,
        scratch, state, phases, parts, state[TARGET], 1.0,
    )  # fmt: skip
    return bool(over <= 1.0)
