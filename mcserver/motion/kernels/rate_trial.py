"""A change of the playback rate tried on the very setpoints that it would give.

Their first, second and third differences are held against the limits of the axes, and the torques that they
ask for against those of the joints. A try ends at the first setpoint that passes a limit. Time in cycles, u
in rows.
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
    RATE,
    SLOPE,
    phase_advance,
    total_advance,
    total_time,
)
from mcserver.motion.kernels.rate_window import (
    BOUNDS,
    BOUNDS_HERE,
    EDGE,
    FAR,
    FIRST,
    LIMIT,
    PASSED,
    PLACE,
    SAFE,
    SECOND,
    SECONDS,
    SETPOINT,
    STILL,
    U,
    row_position,
    row_velocity,
)
from mcserver.motion.kernels.row_interpolation import SHARP, STEEP, positions_between
from mcserver.motion.kernels.row_torques import torque_share

# Each cycle of a change costs as much as some setpoints of an axis.
CYCLE_COST = 6
# Cycles of steady rate at a plan's end, in which the third difference settles.
SETTLING = 3
# A steady rate that is safe keeps the limits wherever rows do: of a long one only this many cycles at either
# end are looked at.
STEADY_ENDS = 6
# Rows that setpoints about a row span, before it and after it.
SPAN_BEFORE, SPAN_AFTER = 6, 1


@compiled
def _own_difference(
    position: Array, start: Array, at: NDArray[np.int64], row: int, k: int, order: int
) -> float:
    """Return the absolute difference of the rows of one axis that ends at a row, 0 where one is lacking."""
    if row < order:
        return 0.0
    p0 = float(row_position(position, start, at[row])[k])
    p1 = float(row_position(position, start, at[row - 1])[k])
    if order == 1:
        return abs(p0 - p1)
    p2 = float(row_position(position, start, at[row - 2])[k])
    if order == 2:
        return abs(p0 - 2.0 * p1 + p2)
    p3 = row_position(position, start, at[row - 3])[k]
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
def excess(
    position: Array,
    velocity: Array,
    torque: Array,
    pace: Array,
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
        torque: of the rows, shape (n, 3, J), see `row_torques`; J = 0: not to be looked at.
        pace: of the rows, shape (n,). recent: the
            setpoints of the last three cycles, the newest last, shape (3, K). phases, parts: the plan.
            target: its steady rate at the end. give_up: excess from which on the try may end.

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
    if target > 0.0 and edge - end < state[FAR] * max(1.0, target):
        # nothing is looked for while a plan is followed: behind it there has to be room for a stop
        return math.inf, 0
    if end > places[count - 1] + 1e-6 and not ends:
        return math.inf, 0
    last, now = scratch[SETPOINT], scratch[PLACE]
    first, second, still = scratch[FIRST], scratch[SECOND], scratch[STILL]
    bounds, paced = limits[BOUNDS : BOUNDS + 2], 1.0
    for k in range(width):
        last[k] = recent[2, k]
        first[k] = recent[2, k] - recent[1, k]
        second[k] = first[k] - (recent[1, k] - recent[0, k])
    worst, looked, blind = 1.0, 0, 0
    part, begun, before, row = 0, 0.0, 0.0, 0
    joints = torque.shape[2]
    # u of the cycle before and of the one before that, and the place of the former
    last_u, earlier_u, last_row = u, u - state[PASSED], 0
    while joints > 0 and last_row < count and places[last_row] <= u:
        last_row += 1
    cycle = 1
    while cycle <= cycles:
        while part < parts and cycle > begun + phases[part, DURATION]:
            before += phase_advance(phases[part], phases[part, DURATION])
            begun += phases[part, DURATION]
            part += 1
        t = cycle - begun
        if part < parts:
            steady = (
                phases[part, SLOPE] == 0.0
                and phases[part, CURVATURE] == 0.0
                and phases[part, RATE] <= state[SAFE]
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
        own = pace[at[high]] if at[high] >= 0 else 1.0
        if own != paced:
            paced, bounds = own, scratch[BOUNDS_HERE : BOUNDS_HERE + 2]
            for k in range(width):
                bounds[STEEP, k] = limits[BOUNDS + STEEP, k] / own**2
                bounds[SHARP, k] = limits[BOUNDS + SHARP, k] / own**3
        positions_between(
            row_position(position, start, at[low]),
            row_position(position, start, at[high]),
            row_velocity(velocity, still, at[low]),
            row_velocity(velocity, still, at[high]),
            share if high > low else 0.0,
            span * state[SECONDS],
            bounds,
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
            passes |= (abs(one) > scratch[LIMIT, k]) | (abs(two) > scratch[LIMIT + 1, k])
            passes |= abs(three) > scratch[LIMIT + 2, k]
        if joints > 0:
            if blind == 0:
                share = torque_share(
                    torque, places, at, count, last_row, last_u, 0.5 * (here - earlier_u),
                    here - 2.0 * last_u + earlier_u,
                )  # fmt: skip
                looked += joints
                if share > worst:
                    worst = share
                    if worst > give_up:
                        return worst, looked
            earlier_u, last_u, last_row = last_u, here, row
        if blind > 0:
            blind -= 1
        elif passes:
            about = min(row, count - 1)
            for k in range(width):
                for order in range(3):
                    size = abs(first[k]) if order == 0 else (abs(second[k]) if order == 1 else abs(now[k]))
                    limit = scratch[LIMIT + order, k]
                    if size > limit:
                        over = _share_of_limit(position, start, at, count, about, k, order + 1, size, limit)
                        worst = max(worst, over)
            looked += width
            if worst > give_up:
                return worst, looked
        cycle += 1
    return worst, looked
