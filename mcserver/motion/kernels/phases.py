"""Moves as phases of constant jerk, and the times at which a velocity profile reaches positions.

A phase is one row of `PHASE` numbers: how long it lasts [s], and the coordinate, speed, acceleration and jerk
at its start.
"""

from __future__ import annotations

import math

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

PHASE = 5
# A ramp has three phases.
PHASES_PER_MOVE = 3


@compiled
def _phase(
    phases: Array, at: int, time: float, position: float, speed: float, acceleration: float, jerk: float
) -> int:
    phases[at, 0] = time
    phases[at, 1] = position
    phases[at, 2] = speed
    phases[at, 3] = acceleration
    phases[at, 4] = jerk
    return at + 1


@compiled
def moves_to_phases(moves: Array, count: int, phases: Array, at: int, position: float) -> int:
    """Write the phases of moves from row ``at`` on; the coordinate begins at ``position``.

    Returns:
        The row after the last one.
    """
    for index in range(count):
        start, end = moves[index, 0], moves[index, 1]
        length = moves[index, 4]
        if start == end:
            at = _phase(phases, at, length / start, position, start, 0.0, 0.0)
            position += length
            continue
        change = abs(end - start)
        sign = 1.0 if end > start else -1.0
        acceleration, jerk = moves[index, 2], moves[index, 3]
        if math.isinf(jerk):
            at = _phase(phases, at, change / acceleration, position, start, sign * acceleration, 0.0)
            position += length
            continue
        peak = min(acceleration, math.sqrt(change * jerk))
        rise = peak / jerk
        plateau = max(change / peak - rise, 0.0)
        a, j = sign * peak, sign * jerk
        at = _phase(phases, at, rise, position, start, 0.0, j)
        speed = start + rise * a / 2.0
        here = position + rise * (start + rise * a / 6.0)
        if plateau > 0.0:
            at = _phase(phases, at, plateau, here, speed, a, 0.0)
            here += plateau * (speed + plateau * a / 2.0)
            speed += plateau * a
        at = _phase(phases, at, rise, here, speed, a, -j)
        position += length
    return at


@compiled
def time_within(phases: Array, row: int, target: float) -> float:
    """Return the time within a phase at which the coordinate reaches ``target``, which lies in it [s]."""
    lasts: float = phases[row, 0]
    v: float = phases[row, 2]
    a: float = phases[row, 3]
    j: float = phases[row, 4]
    far: float = target - phases[row, 1]
    if far <= 0.0:
        return 0.0
    if a == 0.0 and j == 0.0:
        return min(far / v, lasts) if v > 0.0 else lasts
    if j == 0.0:
        # v x + a x²/2 = far, without cancellation
        return min(2.0 * far / (v + math.sqrt(max(v * v + 2.0 * a * far, 0.0))), lasts)
    low, high = 0.0, lasts
    x = min(far / v, lasts) if v > 0.0 else 0.5 * lasts
    # Newton kept inside a bisection: near rest the slope vanishes
    for _ in range(100):
        short = x * (v + x * (a / 2.0 + x * j / 6.0)) - far
        if short < 0.0:
            low = x
        else:
            high = x
        slope = v + x * (a + x * j / 2.0)
        new = x - short / slope if slope > 0.0 else low
        if not low < new < high:
            new = (low + high) / 2.0
        if abs(new - x) <= 1e-16 * lasts or high - low <= 1e-16 * lasts:
            return new
        x = new
    return high


@compiled
def times_at_positions(
    start: Array, duration: float, rows: Array, end: float, positions: Array, tiny: float, times: Array
) -> None:
    """Write the first times at which a velocity profile reaches ``positions``, which increase [s].

    Args:
        start: when each phase begins, shape (n,). rows: phases, shape (n, `PHASE`). end: the last coordinate.
        tiny: nearer to the end than this is the end.
        times: written, the shape of ``places``.
    """
    phase, last = 0, len(start) - 1
    for index in range(len(positions)):
        target = positions[index]
        if target >= end - tiny:
            times[index] = duration
        elif target <= rows[0, 1]:
            times[index] = 0.0
        else:
            while phase < last and rows[phase + 1, 1] < target:
                phase += 1
            times[index] = start[phase] + time_within(rows, phase, target)


@compiled
def speeds_at(
    rows: Array, count: int, positions: Array, offset: float, first: int, last: int, speeds: Array
) -> None:
    """Write the speeds at ``positions[first:last] - offset``, which increase, into
    ``speeds[first:last]``.
    """
    phase = 0
    for index in range(first, last):
        target = positions[index] - offset
        while phase < count - 1 and rows[phase + 1, 1] < target:
            phase += 1
        x = time_within(rows, phase, target)
        speeds[index] = rows[phase, 2] + x * (rows[phase, 3] + x * rows[phase, 4] / 2.0)
