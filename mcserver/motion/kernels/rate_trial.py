"""Try a change of the playback rate on the setpoints that it would give.

Their first, second and third differences are compared with the limits of the axes, and their torques with
those of the joints. A try ends at the first setpoint that exceeds a limit by too much. Time in cycles, u in
rows.
"""

from __future__ import annotations

import math

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
    FIRST,
    LIMIT,
    PLACE,
    SECOND,
    SETPOINT,
    STILL,
    Change,
    Places,
    RateState,
    RingRows,
    Window,
    row_position,
    row_velocity,
)
from mcserver.motion.kernels.row_interpolation import positions_between
from mcserver.motion.kernels.row_torques import torque_share

# Cost of a cycle of a change besides its setpoints, in setpoints of one axis.
CYCLE_COST = 6
# Cycles of steady rate at a plan's end, in which the third difference settles.
SETTLING = 3
# A steady rate keeps the limits wherever rows do: only this many cycles at each end of it are tried.
STEADY_ENDS = 6
# Rows before and after a setpoint whose own differences are allowed there.
SPAN_BEFORE, SPAN_AFTER = 6, 1


@compiled
def _own_difference(position: Array, start: Array, places: Places, row: int, k: int, order: int) -> float:
    """Return the absolute difference of one axis over the rows up to one; 0 where rows are missing."""
    if row < order:
        return 0.0
    at = places.at
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
def _worst_share(
    rows: RingRows, start: Array, places: Places, row: int, differences: Array, limits: Array
) -> float:
    """Return the greatest ratio of a setpoint's differences to their limits, at least 1.

    A limit is raised to the difference that rows near the setpoint have themselves.

    Args:
        row: index of the setpoint in ``places``. differences: first to third, shape (3, K).
            limits: of them, shape (3, K).
    """
    worst = 1.0
    for k in range(differences.shape[1]):
        for order in range(3):
            size, allowed = abs(differences[order, k]), limits[order, k]
            if size <= allowed:
                continue
            for near in range(max(row - SPAN_BEFORE, 0), min(row + SPAN_AFTER, places.length - 1) + 1):
                own = _own_difference(rows.position, start, places, near, k, order + 1)
                allowed = max(allowed, own)
            worst = max(worst, size / allowed)
    return worst


@compiled
def excess(
    rows: RingRows,
    window: Window,
    places: Places,
    limits: Array,
    state: RateState,
    change: Change,
    give_up: float,
    memory: Array,
) -> tuple[float, int]:
    """Try a change of the rate on its setpoints.

    Args:
        limits: of the axes, shape (`LIMITS`, K). give_up: ratio above which the try ends.
        memory: shape (`MEMORY`, K), with the limits of this search (`set_limits`).

    Returns:
        The greatest ratio to a limit, 1 within all limits; infinite: not allowed in any case. And the cost of
        the try, in setpoints of one axis.
    """
    position, velocity, torque = rows.position, rows.velocity, rows.torque
    phases, parts, target = change.phases, change.length, change.target
    u, edge, count, recent = state.u, state.edge, places.length, window.recent
    width = position.shape[1]
    duration = total_time(phases, parts)
    cycles = math.ceil(duration - 1e-9) + SETTLING
    end = u + total_advance(phases, parts) + (cycles - duration) * target
    if end > edge + 1e-6:
        return math.inf, 0
    if target > 0.0 and edge - end < state.far:
        # no stop is searched for during a change: after it there has to be room for one
        return math.inf, 0
    if end > places.u[count - 1] + 1e-6 and not places.ends:
        return math.inf, 0
    last, now, still = memory[SETPOINT], memory[PLACE], memory[STILL]
    first, second = memory[FIRST], memory[SECOND]
    bounds = limits[BOUNDS : BOUNDS + 2]
    for k in range(width):
        last[k] = recent[2, k]
        first[k] = recent[2, k] - recent[1, k]
        second[k] = first[k] - (recent[1, k] - recent[0, k])
    worst, looked, blind = 1.0, 0, 0
    part, begun, before, row = 0, 0.0, 0.0, 0
    joints = torque.shape[2]
    # u of the last cycle and of the one before it, and the row of the last cycle
    last_u, earlier_u, last_row = u, u - state.passed, 0
    while joints > 0 and last_row < count and places.u[last_row] <= u:
        last_row += 1
    cycle = 1
    while cycle <= cycles:
        while part < parts and cycle > begun + phases[part, DURATION]:
            before += phase_advance(phases[part], phases[part, DURATION])
            begun += phases[part, DURATION]
            part += 1
        t = cycle - begun
        if part < parts:
            steady = phases[part, SLOPE] == 0.0 and phases[part, CURVATURE] == 0.0
            until = math.floor(begun + phases[part, DURATION]) - STEADY_ENDS
            if steady and t > STEADY_ENDS and until > cycle + STEADY_ENDS:
                # the three cycles after the skipped ones only rebuild the differences
                cycle, blind = until, 3
                t = cycle - begun
            moved = before + phase_advance(phases[part], t)
            rate = phases[part, RATE] + t * (phases[part, SLOPE] + t * phases[part, CURVATURE] / 2.0)
        else:
            moved, rate = before + t * target, target
        if rate < -1e-9 or (cycle == 1 and moved < -1e-9):
            return math.inf, looked
        here = u + moved
        while row < count and places.u[row] <= here:
            row += 1
        while row > 0 and places.u[row - 1] > here:
            row -= 1
        # the interval before the first row after u; beyond the rows, the last interval
        low = min(max(row - 1, 0), max(count - 2, 0))
        high = min(low + 1, count - 1)
        span = places.u[high] - places.u[low] if high > low else 1.0
        share = min(max((here - places.u[low]) / span, 0.0), 1.0)
        positions_between(
            row_position(position, window.start, places.at[low]),
            row_position(position, window.start, places.at[high]),
            row_velocity(velocity, still, places.at[low]),
            row_velocity(velocity, still, places.at[high]),
            share if high > low else 0.0,
            span * state.seconds,
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
            passes |= (abs(one) > memory[LIMIT, k]) | (abs(two) > memory[LIMIT + 1, k])
            passes |= abs(three) > memory[LIMIT + 2, k]
        if joints > 0:
            if blind == 0:
                worst = max(
                    worst,
                    torque_share(
                        torque, places.u, places.at, count, last_row, last_u, 0.5 * (here - earlier_u),
                        here - 2.0 * last_u + earlier_u,
                    ),
                )  # fmt: skip
                looked += joints
            earlier_u, last_u, last_row = last_u, here, row
        if blind > 0:
            blind -= 1
        elif passes:
            here_limits, differences = memory[LIMIT : LIMIT + 3], memory[FIRST : FIRST + 3]
            over = _worst_share(rows, window.start, places, min(row, count - 1), differences, here_limits)
            worst = max(worst, over)
            looked += width
        if worst > max(give_up, 1.0):
            return worst, looked
        cycle += 1
    return worst, looked
