"""Changes of the playback rate: s-curves in closed form, as phases of constant curvature.

Time is counted in cycles and u in rows, one row a cycle at a rate of 1. The rate's slope r' [1/cycle] bounds
the acceleration that a change of rate adds along the path, and r'' [1/cycle²] the jerk.
"""

from __future__ import annotations

import math

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Columns of a phase: its duration [cycles], and the rate, its slope and its curvature at the start.
DURATION, RATE, SLOPE, CURVATURE = range(4)
# Phases of a change, the lag before it, the steady rate and a further change.
MOST_PHASES = 8
# A smaller change of rate counts as no change [1].
SAME_RATE = 1e-12
# Two values of u that are closer are the same [cycles].
NEAR_U = 1e-7
# A rate near 1 at which rows interpolated at the vertices of exact paths keep the acceleration limit: its
# square leaves what interpolation may add.
NEXT_RATE = 0.97
# Longest wait for a change to a rate of 1 to begin so that u meets the rows [cycles].
LONGEST_LAG = 100.0
# A rate below which a motion is stopped at once instead of going on at it [1].
LEAST_RATE = 1e-3


@compiled
def phase_advance(phase: Array, t: float) -> float:
    """Return the rows that u passes in the first t cycles of a phase."""
    return float(t * (phase[RATE] + t * (phase[SLOPE] / 2.0 + t * phase[CURVATURE] / 6.0)))


@compiled
def total_time(phases: Array, count: int) -> float:
    """Return the duration of the first phases [cycles]."""
    total = 0.0
    for i in range(count):
        total += phases[i, DURATION]
    return total


@compiled
def total_advance(phases: Array, count: int) -> float:
    """Return the rows that u passes in the first phases."""
    total = 0.0
    for i in range(count):
        total += phase_advance(phases[i], phases[i, DURATION])
    return total


@compiled
def add_phase(phases: Array, count: int, duration: float, rate: float, slope: float, curvature: float) -> int:
    """Append a phase; return how many there are."""
    phases[count, DURATION] = duration
    phases[count, RATE] = rate
    phases[count, SLOPE] = slope
    phases[count, CURVATURE] = curvature
    return count + 1


@compiled
def add_ramp(
    phases: Array, count: int, rate: float, slope: float, target: float, most: float, curvature: float
) -> int:
    """Append the fastest change from a rate with a slope to a steady target rate, at most three phases.

    Args:
        most: the largest slope [1/cycle]. curvature: the largest r'' [1/cycle²], may be infinite.

    Returns:
        How many phases there are.
    """
    if math.isinf(curvature):
        change = target - rate
        if abs(change) <= SAME_RATE:
            return count
        return add_phase(phases, count, abs(change) / most, rate, math.copysign(most, change), 0.0)
    # up or down from the rate that is reached when the slope has come to 0
    up = 1.0 if target >= rate + 0.5 * slope * abs(slope) / curvature else -1.0
    square = max(curvature * up * (target - rate) + 0.5 * slope * slope, 0.0)
    peak = min(math.sqrt(square), max(most, up * slope))
    first = (peak - up * slope) / curvature
    hold = max((square - peak * peak) / (curvature * peak), 0.0) if peak > 0.0 else 0.0
    for i in range(3):
        duration = first if i == 0 else (hold if i == 1 else peak / curvature)
        change = up * curvature if i == 0 else (0.0 if i == 1 else -up * curvature)
        if duration > 0.0:
            count = add_phase(phases, count, duration, rate, slope, change)
            rate += duration * (slope + 0.5 * duration * change)
            slope += duration * change
    return count


@compiled
def change_onto_rows(
    phases: Array, u: float, rate: float, slope: float, most: float, curvature: float
) -> int:
    """Write the change to a rate of 1 that ends with u on whole rows, which are then played exactly.

    The change is delayed for that, at most until u has fallen back by a row. From a rate so near to 1 that
    this would take long, or with a slope, it goes via `NEXT_RATE`.

    Returns:
        The number of phases.
    """
    count = add_ramp(phases, 0, rate, slope, 1.0, most, curvature)
    if abs(rate - 1.0) <= SAME_RATE and slope == 0.0:
        return count
    off = _off_rows(phases, count, u)
    if off == 0.0:
        return count
    if slope != 0.0 or abs(1.0 - rate) * LONGEST_LAG < 1.0:
        # wait at a rate near 1
        count = add_ramp(phases, 0, rate, slope, NEXT_RATE, most, curvature)
        count = add_phase(phases, count, 0.0, NEXT_RATE, 0.0, 0.0)
        waits = count - 1
        count = add_ramp(phases, count, NEXT_RATE, 0.0, 1.0, most, curvature)
        phases[waits, DURATION] = _off_rows(phases, count, u) / (1.0 - NEXT_RATE)
        return count
    lag = off / (1.0 - rate) if rate < 1.0 else (1.0 - off) / (rate - 1.0)
    return add_ramp(phases, add_phase(phases, 0, lag, rate, 0.0, 0.0), rate, slope, 1.0, most, curvature)


@compiled
def _off_rows(phases: Array, count: int, u: float) -> float:
    """Return the fraction of a row by which u misses the rows once the rate is 1."""
    off = (u + total_advance(phases, count) - total_time(phases, count)) % 1.0
    return 0.0 if min(off, 1.0 - off) < NEAR_U else float(off)


@compiled
def stop_at_edge(
    phases: Array, room: float, rate: float, slope: float, target: float, most: float, curvature: float
) -> int:
    """Write the change that ends at rest after ``room`` rows, at most at the target rate on the way.

    Returns:
        The number of phases; below 0: there is too little room.
    """
    goal, high, low = target, target, 0.0
    left = _left_by_stop(phases, room, rate, slope, goal, most, curvature)
    if left < 0.0:
        for _ in range(30):
            goal = 0.5 * (low + high)
            left = _left_by_stop(phases, room, rate, slope, goal, most, curvature)
            if left >= 0.0:
                low = goal
            else:
                high = goal
        goal = low
        left = _left_by_stop(phases, room, rate, slope, goal, most, curvature)
    if left < 0.0:
        return -1
    if goal <= LEAST_RATE:
        return add_ramp(phases, 0, rate, slope, goal, most, curvature)
    # a steady part between the change to a rate and the change to rest
    there = add_ramp(phases, 0, rate, slope, goal, most, curvature)
    there = add_phase(phases, there, left / goal, goal, 0.0, 0.0)
    return add_ramp(phases, there, goal, 0.0, 0.0, most, curvature)


@compiled
def _left_by_stop(
    phases: Array, room: float, rate: float, slope: float, goal: float, most: float, curvature: float
) -> float:
    """Return the rows that a change to a rate and then to rest leaves of ``room``."""
    count = add_ramp(phases, 0, rate, slope, goal, most, curvature)
    count = add_ramp(phases, count, goal, 0.0, 0.0, most, curvature)
    return room - total_advance(phases, count)
