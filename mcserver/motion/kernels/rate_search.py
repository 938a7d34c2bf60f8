"""Search for a change of the playback rate that keeps the limits of all axes, within one cycle.

A change is tried on the setpoints that it would give (`rate_trial.py`); nothing is allocated or copied. Time
in cycles, u in rows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.row_torques import NUMBERS
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.envelope import find_excess, find_tip_outside, find_wrong_row, tip_positions
from mcserver.motion.kernels.rate_changes import (
    MOST_PHASES,
    NEXT_RATE,
    add_phase,
    add_ramp,
    change_onto_rows,
    stop_at_edge,
)
from mcserver.motion.kernels.rate_trial import excess
from mcserver.motion.kernels.rate_window import (
    LIMIT,
    LIMITS,
    MEMORY,
    RAW_ACCELERATION,
    RAW_JERK,
    SPEED,
    STILL,
    Change,
    Places,
    RateState,
    RingRows,
    Window,
    find_window,
    rests_at_edge,
    row_velocity,
    set_limits,
)
from mcserver.motion.kernels.row_interpolation import interpolate_rows
from mcserver.motion.kernels.row_torques import change_limit
from mcserver.motion.kernels.target_tracking import follow_reference, follow_targets

# Shares of the limits with which a change of rate is tried, the fastest first: more shares find a faster
# change where rows leave little of the limits.
SHARES = (1.0, 0.85, 0.65, 0.4, 0.2, 0.08)
# For a stop on an edge, shares of the rate that are tried until then: where rows brake before the edge at an
# axis's limits, only a motion that is slow by then can stop on it.
NEAR_GOALS = (1.0, 0.6, 0.3, 0.1, 0.03)
# Tries of the longest search, that for a stop on an edge.
TRIES = len(NEAR_GOALS) * len(SHARES)
# Parts of a change, and the share of the limits that each is tried with, after those of the whole change:
# where rows use all of a torque or jerk limit, a change is possible in small parts only, since the demand of
# the motion falls with the square or the cube of the rate.
PARTIAL = (
    (0.5, 0.65), (0.5, 0.2), (0.5, 0.08), (0.2, 0.4), (0.2, 0.2), (0.2, 0.08), (0.2, 0.03), (0.06, 0.2),
    (0.06, 0.08), (0.06, 0.03), (0.06, 0.01), (0.02, 0.08), (0.02, 0.03), (0.02, 0.01), (0.06, 0.003),
    (0.02, 0.003),
)  # fmt: skip
# A smaller change is not made in parts [1].
LEAST_PART = 0.01
# Where no change at full speed keeps the limits, motion at rest begins with time stretched by a power of
# this: with the rate scaled by g, its slope by g² and its curvature by g³, velocity, acceleration and jerk of
# any rows are scaled by g, g² and g³.
SLOWER = 0.82
# Largest such power: slower changes take long to try.
SLOWEST = 18
# Work of one cycle, in setpoints of one axis, after which the search goes on in the next cycle; the try that
# exceeds it is completed.
BUDGET = 5_000
# Cost of one try besides its setpoints, in the same unit.
TRY_COST = 100
# Largest slope of the rate, where axes hardly move [1/cycle].
MAX_SLOPE = 0.5


class Manner(NamedTuple):
    """Mode of a search.

    Attributes:
        urgent: ignore jerk and torques. by_any: also return the change that exceeds the limits least.
        slowly: stretch time, from rest or before an edge. in_parts: the change may go a part of the way.
        from_try: number of the first try.
    """

    urgent: bool
    by_any: bool
    slowly: bool
    in_parts: bool
    from_try: int


class SearchMemory(NamedTuple):
    """Preallocated memory of a search.

    Attributes:
        places, at: shape (2 n + 2,) for n rows of the ring. axes: shape (`MEMORY`, K), its last row 0.
        phases, spare: shape (`MOST_PHASES`, 4), written: the change that was found, and the one that exceeds
            the limits least.
    """

    places: Array
    at: NDArray[np.int64]
    axes: Array
    phases: Array
    spare: Array

    @classmethod
    def of(cls, rows: int, axes: int) -> SearchMemory:
        """Return memory for a ring of so many rows and axes."""
        places = 2 * rows + 2
        phases = np.zeros((2, MOST_PHASES, 4))
        memory = np.zeros((MEMORY, axes))
        return cls(np.zeros(places), np.zeros(places, np.int64), memory, phases[0], phases[1])


@compiled
def _straight_limits(
    rows: RingRows, places: Places, limits: Array, memory: Array, state: RateState, change: float
) -> tuple[float, float]:
    """Return the largest slope and curvature of the rate on the rows of a change, as if these were straight.

    Args:
        change: of the rate [1].
    """
    width = rows.velocity.shape[1]
    fastest = max(state.rate, state.target)
    speed, still = memory[SPEED], memory[STILL]
    reach = 16.0
    slope = curvature = math.inf
    for _ in range(2):
        low, high = state.u - 1.0, state.u + reach
        for k in range(width):
            speed[k] = 0.0
        for i in range(places.length):
            if low <= places.u[i] <= high:
                row = row_velocity(rows.velocity, still, places.at[i])
                for k in range(width):
                    here = abs(row[k])
                    speed[k] = here if here > speed[k] else speed[k]
        slope, curvature = MAX_SLOPE, math.inf
        if rows.torque.shape[2] > 0:
            for i in range(places.length):
                if places.at[i] >= 0 and low <= places.u[i] <= high:
                    slope = min(slope, change_limit(rows.torque, places.at[i]))
        for k in range(width):
            if math.isinf(memory[LIMIT, k]):
                continue
            moved = speed[k] * state.seconds + 1e-30
            slope = min(slope, limits[RAW_ACCELERATION, k] / moved)
            curvature = min(curvature, limits[RAW_JERK, k] / moved)
        if not math.isinf(curvature):
            curvature = min(curvature, MAX_SLOPE)
        reach = (change / slope + slope / curvature) * fastest + 4.0
    return slope, curvature


@compiled
def _whole_change(phases: Array, state: RateState, slope: float, curvature: float) -> Change:
    """Write the change to the ordered rate, onto whole rows where that is 1."""
    if state.target == 1.0:
        return Change(
            phases, change_onto_rows(phases, state.u, state.rate, state.slope, slope, curvature), 1.0
        )
    count = add_ramp(phases, 0, state.rate, state.slope, state.target, slope, curvature)
    return Change(phases, count, state.target)


@compiled
def _stop_before_edge(number: int, phases: Array, state: RateState, slope: float, curvature: float) -> Change:
    """Write a change that ends at rest on the edge; ``number``: of `TRIES`."""
    which, share = number // len(SHARES), SHARES[number % len(SHARES)]
    goal = state.target * NEAR_GOALS[which]
    if state.target < state.rate and which > 0:
        # rows that leave no room for a lower rate now may leave it later
        goal = max(state.rate * NEAR_GOALS[which - 1], state.target)
    room, slope, curvature = state.edge - state.u, slope * share, curvature * share
    count = stop_at_edge(phases, room, state.rate, state.slope, goal, slope, curvature)
    return Change(phases, count, 0.0)


@compiled
def _part_of_change(number: int, phases: Array, state: RateState, slope: float, curvature: float) -> Change:
    """Write a change that goes a part of the way to the ordered rate; no phases: there is none.

    Args:
        number: of the try: first the whole change, the fastest first, then smaller and smaller parts of it.
    """
    if number < len(SHARES):
        share = SHARES[number]
        return _whole_change(phases, state, slope * share, curvature * share)
    number -= len(SHARES)
    rate, target = state.rate, state.target
    if number >= len(PARTIAL) or abs(target - rate) < LEAST_PART:
        return Change(phases, -1, 0.0)
    part, share = PARTIAL[number]
    goal = rate + part * (target - rate)
    slope, curvature = slope * share, curvature * share
    if target == 1.0 and rate < 1.0 and goal > NEXT_RATE:
        # from a rate nearer to 1, u would take long to meet the rows
        goal = NEXT_RATE if rate < NEXT_RATE else 1.0
        if goal == 1.0:
            return _whole_change(phases, state, slope, curvature)
    return Change(phases, add_ramp(phases, 0, rate, state.slope, goal, slope, curvature), goal)


@compiled
def _slow_change(
    number: int, near: bool, phases: Array, state: RateState, slope: float, curvature: float
) -> Change:
    """Write a change from rest, or before an edge, with stretched time; no phases: there is none.

    Args:
        number: of the try, the fastest first. near: the motion has to stop before the edge.
    """
    if number >= SLOWEST:
        return Change(phases, -1, 0.0)
    goal = (state.rate if state.rate > 0.0 else state.target * SLOWER) * SLOWER**number
    slope, curvature = slope * goal**2, curvature * goal**3
    if near:
        room = state.edge - state.u
        count = stop_at_edge(phases, room, state.rate, state.slope, goal, slope, curvature)
        return Change(phases, count, 0.0)
    return Change(phases, add_ramp(phases, 0, state.rate, state.slope, goal, slope, curvature), goal)


@compiled
def search_rate(
    rows: RingRows, window: Window, limits: Array, state: RateState, manner: Manner, memory: SearchMemory
) -> tuple[int, float, int, float, int]:
    """Search for the fastest change of the rate that keeps all limits, within this cycle's budget.

    Args:
        limits: of the axes, shape (`LIMITS`, K).

    Returns:
        Number of phases of the change (below 0: none found) and its final rate; the same of the spare one;
        and the number of tries, a skipped one included.
    """
    axes = memory.axes
    places = find_window(rows, window, limits, state.seconds, memory.places, memory.at)
    set_limits(rows, window, limits, manner.urgent, axes)
    rate, target, room = state.rate, state.target, state.edge - state.u
    near = room < state.far
    keeps = near and state.slope == 0.0 and 0.0 < rate <= target
    if keeps and rests_at_edge(rows, places, state.edge, state.seconds, axes):
        # the rows come to rest on the edge by themselves: keep the present rate until there
        kept = Change(memory.phases, add_phase(memory.phases, 0, room / rate, rate, 0.0, 0.0), 0.0)
        over, _ = excess(rows, window, places, limits, state, kept, 1.0, axes)
        if over <= 1.0:
            return kept.length, 0.0, -1, 0.0, 0
    difference = max(rate, target) if near else max(abs(target - rate), 0.1)
    slope, curvature = _straight_limits(rows, places, limits, axes, state, difference)
    if manner.urgent:
        curvature = math.inf
    least, spare_parts, spare_target = math.inf, -1, 0.0
    looked, tried = 0, 0
    while tried < TRIES and looked < BUDGET:
        number = (manner.from_try + tried) % TRIES
        tried += 1
        if manner.slowly:
            change = _slow_change(number, near, memory.phases, state, slope, curvature)
        elif near:
            change = _stop_before_edge(number, memory.phases, state, slope, curvature)
        elif manner.in_parts or number < len(SHARES):
            change = _part_of_change(number, memory.phases, state, slope, curvature)
        else:
            continue
        if change.length < 0:
            continue
        give_up = max(1.0, least) if manner.by_any else 1.0
        over, seen = excess(rows, window, places, limits, state, change, give_up, axes)
        looked += seen + TRY_COST
        if over <= 1.0:
            return change.length, change.target, spare_parts, spare_target, tried
        if manner.by_any and over < least:
            least, spare_parts, spare_target = over, change.length, change.target
            for i in range(change.length):
                for j in range(memory.phases.shape[1]):
                    memory.spare[i, j] = memory.phases[i, j]
    return -1, 0.0, spare_parts, spare_target, tried


def warm_up_playback() -> None:
    """Compile the executor's kernels, or read them from the cache, before the first cycle."""
    width, size = 1, 4
    numbers, some = np.zeros((size, width)), np.ones(width, np.bool_)
    rows = RingRows(np.arange(size), numbers, numbers, np.zeros((size, NUMBERS, 1)))
    window = Window(0, size, False, False, 0.0, numbers[0], some, some, numbers[:3])
    state = RateState(1.0, 1.0, 0.0, 1.0, math.inf, 1.0, 1e-3, 1.0)
    manner = Manner(False, False, False, False, 0)
    search_rate(rows, window, np.ones((LIMITS, width)), state, manner, SearchMemory.of(size, width))
    interpolate_rows(numbers, numbers, 0, 1, 0.5, 1e-3, 1.0, numbers[:2], some, numbers[2], numbers[3])
    masks, zero, row = np.zeros(size, np.uint64), np.zeros(1, np.intp), numbers[0]
    find_wrong_row(numbers, numbers, masks, np.ones(size), 0, 1, row, row, row)
    find_excess(row, row, row, row, row, 1.0, some, some)
    tip_positions(np.zeros((2, 3, 4)), some, numbers[:1])
    states, knots = np.zeros((1, 3)), np.zeros((2, 3))
    follow_targets(states, states.copy(), np.ones((1, 5)), 0.0, 1e-3, False)
    follow_reference(states, states.copy(), knots, np.ones((1, 5)), 0.0, np.zeros(1), 1e-3, False)
    find_tip_outside(np.zeros((2, 3, 4)), some, zero, numbers, masks, row, 0, 1, np.zeros(3), np.zeros(3))
