"""Synchronized minimum-time trajectories of axes from state to state, under acceleration and jerk limits.

For a time T the accelerations a(t) of an axis with given ends, given change of speed, and both limits form a
convex set, so the distances that they cover form an interval. Its ends are covered by the accelerations that
come as early and as late as possible, which have one transition each; a distance between is covered by a mean
of the two, which keeps the limits too. So whether T suffices is known in closed form, and the least T is
found by bisection. An axis with time to spare cruises in between, so that it does not run ahead or back.
"""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Bisections for the time.
HALVINGS = 14
# Tolerance for rounding of a distance or a speed, as a share of what the limits allow in the time.
ROUNDING = 1e-9
# The same for a course that was found by bisection.
CLOSE = 1e-7
# Knots of a course: acceleration by time, piecewise linear.
KNOTS = 8
# Phases of a mean of two courses.
PHASES = 2 * KNOTS


@compiled
def _knots(c: float, time: float, a0: float, a1: float, most: float, jerk: float, knots: Array) -> float:
    """Write the course that rises to a line falling from ``c`` at t = 0, falls, and rises to its end.

    Returns its change of speed.

    Args:
        most: greatest acceleration [m/s²]. knots: times and accelerations, shape (KNOTS, 2), written.
    """
    knots[0, 0], knots[0, 1] = 0.0, a0
    if 0.5 * (a0 + c) <= most:
        knots[1:3, 0], knots[1:3, 1] = 0.5 * (c - a0) / jerk, 0.5 * (a0 + c)
    else:
        knots[1:3, 1] = most
        knots[1, 0], knots[2, 0] = (most - a0) / jerk, (c - most) / jerk
    lowest = 0.5 * (c + a1 - jerk * time)
    if lowest >= -most:
        knots[3:5, 0], knots[3:5, 1] = 0.5 * (c - a1 + jerk * time) / jerk, lowest
    else:
        knots[3:5, 1] = -most
        knots[3, 0], knots[4, 0] = (c + most) / jerk, time - (a1 + most) / jerk
    knots[5:, 0], knots[5:, 1] = time, a1
    change = 0.0
    for i in range(KNOTS - 1):
        change += 0.5 * (knots[i + 1, 0] - knots[i, 0]) * (knots[i + 1, 1] + knots[i, 1])
    return change


@compiled
def _early(time: float, a0: float, a1: float, change: float, most: float, jerk: float, knots: Array) -> bool:
    """Write the course that covers the greatest distance in a time; False: none makes the change of speed.

    Args:
        a0, a1: acceleration at its ends, irrelevant where jerk is not limited. change: of speed [m/s].
        most, jerk: the limits. knots: times and accelerations, shape (KNOTS, 2), written.
    """
    slack = ROUNDING * most * time
    if math.isinf(jerk):
        turn = 0.5 * (time + change / most)
        knots[:3, 1], knots[3:, 1] = most, -most
        knots[0, 0], knots[1:5, 0], knots[5:, 0] = 0.0, min(max(turn, 0.0), time), time
        return abs(change) <= most * time + slack
    if abs(a1 - a0) > jerk * time * (1.0 + ROUNDING):
        return False
    # c of the line between the two: from where it only falls at first to where it only falls at last
    low, high = a0, a1 + jerk * time
    least, greatest = (
        _knots(low, time, a0, a1, most, jerk, knots),
        _knots(high, time, a0, a1, most, jerk, knots),
    )
    if change < least - slack or change > greatest + slack:
        return False
    # the change of speed grows by how long the line lasts, which is linear in c between these
    places = np.empty(4)
    places[0], places[3] = low, high
    tops, bottoms = 2.0 * most - a0, jerk * time - a1 - 2.0 * most
    places[1] = min(max(min(tops, bottoms), low), high)
    places[2] = min(max(max(tops, bottoms), low), high)
    left, base, lasts = low, least, _lasts(low, time, a0, a1, most, jerk)
    for i in range(1, 4):
        right = places[i]
        reached = _knots(right, time, a0, a1, most, jerk, knots)
        then = _lasts(right, time, a0, a1, most, jerk)
        if change <= reached or i == 3:
            rest = max(change - base, 0.0)
            bend = (then - lasts) / (right - left) if right > left else 0.0
            root = math.sqrt(max(lasts * lasts + 2.0 * bend * rest, 0.0))
            step = 2.0 * rest / (lasts + root) if lasts + root > 0.0 else 0.0
            _knots(min(left + step, right), time, a0, a1, most, jerk, knots)
            return True
        left, base, lasts = right, reached, then
    return True


@compiled
def _lasts(c: float, time: float, a0: float, a1: float, most: float, jerk: float) -> float:
    """Return how long the course follows the line that falls from ``c`` [s]."""
    start = 0.5 * (c - a0) / jerk if 0.5 * (a0 + c) <= most else (c - most) / jerk
    lowest = 0.5 * (c + a1 - jerk * time)
    end = 0.5 * (c - a1 + jerk * time) / jerk if lowest >= -most else (c + most) / jerk
    return max(end - start, 0.0)


@compiled
def _covered(knots: Array, v0: float) -> float:
    """Return the distance that a course covers from an initial speed."""
    distance, v = 0.0, v0
    for i in range(KNOTS - 1):
        x = knots[i + 1, 0] - knots[i, 0]
        distance += x * (v + x * (2.0 * knots[i, 1] + knots[i + 1, 1]) / 6.0)
        v += 0.5 * x * (knots[i, 1] + knots[i + 1, 1])
    return distance


@compiled
def _extremes(time: float, states: Array, most: float, jerk: float, soon: Array, late: Array) -> float:
    """Write the courses that cover the greatest and the least distance.

    Returns the share of ``late`` in their mean that covers the given distance; NaN: none does.

    Args:
        states: travel [m], speeds and accelerations at the start and the end, shape (5,).
    """
    travel, v0, v1, a0, a1 = states[0], states[1], states[2], states[3], states[4]
    if not _early(time, a0, a1, v1 - v0, most, jerk, soon):
        return math.nan
    if not _early(time, -a0, -a1, v0 - v1, most, jerk, late):
        return math.nan
    late[:, 1] *= -1.0
    farthest, nearest = _covered(soon, v0), _covered(late, v0)
    slack = ROUNDING * (abs(v0) + abs(v1) + most * time) * time
    if travel > farthest + slack or travel < nearest - slack:
        return math.nan
    span = farthest - nearest
    return min(max((farthest - travel) / span, 0.0), 1.0) if span > slack else 0.5


@compiled
def _enough(time: float, states: Array, limits: Array, cruising: bool, soon: Array, late: Array) -> bool:
    """Return whether all axes can reach their end states in a time."""
    for k in range(len(states)):
        if cruising:
            if not _cruise(time, states[k], limits[0, k], limits[1, k], soon):
                return False
        elif math.isnan(_extremes(time, states[k], limits[0, k], limits[1, k], soon, late)):
            return False
    return True


@compiled
def _ramp(v0: float, a0: float, v1: float, most: float, jerk: float, knots: Array) -> float:
    """Write the fastest course from a speed and an acceleration to a steady speed; return its duration.

    Args:
        knots: times and accelerations, shape (4, 2).
    """
    if math.isinf(jerk):
        a = most if v1 >= v0 else -most
        knots[0, 0], knots[1:, 0] = 0.0, abs(v1 - v0) / most
        knots[:2, 1], knots[2:, 1] = a, 0.0
        return abs(v1 - v0) / most
    # up or down from the speed that is reached when the acceleration has come to 0
    up = 1.0 if v1 >= v0 + 0.5 * a0 * abs(a0) / jerk else -1.0
    square = max(jerk * up * (v1 - v0) + 0.5 * a0 * a0, 0.0)
    peak = min(math.sqrt(square), most)
    first = max((peak - up * a0) / jerk, 0.0)
    hold = max((square - peak * peak) / (jerk * peak), 0.0) if peak > 0.0 else 0.0
    knots[0, 0], knots[1, 0], knots[2, 0] = 0.0, first, first + hold
    knots[3, 0] = first + hold + peak / jerk
    knots[0, 1], knots[1:3, 1], knots[3, 1] = a0, up * peak, 0.0
    return first + hold + peak / jerk


@compiled
def _cruise(time: float, states: Array, most: float, jerk: float, knots: Array) -> bool:
    """Write a course with a cruise that covers the distance; return False without one.

    The speed of the cruise is between those at its ends and 0.
    """
    travel, v0, v1, a0, a1 = states[0], states[1], states[2], states[3], states[4]
    low, high = min(v0, v1, 0.0), max(v0, v1, 0.0)
    back = np.empty((4, 2))
    for _ in range(2 * HALVINGS):
        speed = 0.5 * (low + high)
        rise = _ramp(v0, a0, speed, most, jerk, knots[:4])
        fall = _ramp(v1, -a1, speed, most, jerk, back)
        for i in range(4):
            knots[4 + i, 0], knots[4 + i, 1] = time - back[3 - i, 0], -back[3 - i, 1]
        if _covered(knots, v0) < travel:
            low = speed
        else:
            high = speed
    close = abs(_covered(knots, v0) - travel) <= CLOSE * (abs(v0) + abs(v1)) * time
    return close and rise + fall <= time


@compiled
def _course(knots: Array, at: float) -> tuple[float, float]:
    """Return the acceleration and jerk of a course at a time between its knots."""
    i = 0
    while i < KNOTS - 2 and knots[i + 1, 0] <= at:
        i += 1
    lasts = knots[i + 1, 0] - knots[i, 0]
    jerk = (knots[i + 1, 1] - knots[i, 1]) / lasts if lasts > 0.0 else 0.0
    return knots[i, 1] + (at - knots[i, 0]) * jerk, jerk


@compiled
def min_time_trajectories(
    states: Array, limits: Array, longest: float, cruising: bool, trajectories: Array
) -> float:
    """Return the least time in which all axes get from state to state [s]; infinite: not within ``longest``.

    Args:
        states: of each axis travel [m or rad], speeds at start and end, and accelerations there, shape
            (K, 5). limits: of acceleration and jerk, shape (2, K); jerk may be infinite.
        cruising: whether no axis may be faster than at its ends, nor reverse more often than necessary, which
            takes longer.
        trajectories: phases of constant jerk, written: start time, and position from the start, velocity,
            acceleration and jerk then, shape (K, PHASES, 5).
    """
    soon, late = np.empty((KNOTS, 2)), np.empty((KNOTS, 2))
    if not _enough(longest, states, limits, cruising, soon, late):
        return math.inf
    low, time = 0.0, longest
    for _ in range(HALVINGS):
        middle = 0.5 * (low + time)
        if _enough(middle, states, limits, cruising, soon, late):
            time = middle
        else:
            low = middle
    for k in range(len(states)):
        if _cruise(time, states[k], limits[0, k], limits[1, k], soon):
            late[:] = soon
            share = 0.0
        else:
            share = _extremes(time, states[k], limits[0, k], limits[1, k], soon, late)
        starts = np.sort(np.concatenate((soon[:, 0], late[:, 0])))
        p, v = 0.0, states[k, 1]
        for n in range(PHASES):
            lasts = (starts[n + 1] if n + 1 < PHASES else time) - starts[n]
            a, j = states[k, 4], 0.0
            if lasts > 0.0:
                middle = starts[n] + 0.5 * lasts
                a_soon, j_soon = _course(soon, middle)
                a_late, j_late = _course(late, middle)
                j = (1.0 - share) * j_soon + share * j_late
                a = (1.0 - share) * a_soon + share * a_late - 0.5 * lasts * j
            trajectories[k, n, 0], trajectories[k, n, 1], trajectories[k, n, 2] = starts[n], p, v
            trajectories[k, n, 3], trajectories[k, n, 4] = a, j
            p += lasts * (v + lasts * (a / 2.0 + lasts * j / 6.0))
            v += lasts * (a + lasts * j / 2.0)
        # spread the rounding error at the target over the trajectory
        gap = (states[k, 0] - p) / time
        trajectories[k, :, 1] += gap * starts
        trajectories[k, :, 2] += gap
    return time
