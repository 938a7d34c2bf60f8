"""Moves over a distance that take a given time T, within rounding (D-33)."""

from __future__ import annotations

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.ramp_kernels import (
    MAX_MOVES,
    MAX_TABLE_ROWS,
    MOVE,
    duration_of_moves,
    min_time_moves,
    put_cruise,
    put_ramp,
    ramp_time,
)
from mcserver.motion.kernels.sample_limits import Run, make_limit_table

# Timing between two given speeds: T is kept, or even the fastest moves are longer, or the slowest shorter.
KEPT, LATE, EARLY = range(3)
# Tolerance of T for rounding [1 and s], and where several rows of a limit table are needed.
SAME_TIME, SAME_TIME_BY_ROWS = 1e-9, 1e-6
# Bisections for a speed.
HALVINGS = 100
# Most steps, and their ratio, in which a lower speed is searched.
STEPS, STEP = 60, 0.8
_EXACT = 1e-16
# Least length of a cruise, as a share of the distance.
_DUST = 1e-12


@compiled
def _time_by(
    speed: float, distance: float, entry: float, exit_: float, acceleration: float, jerk: float
) -> tuple[float, float]:
    """Return the time of a ramp to a speed, a cruise and a ramp from it [s], and the length of the cruise."""
    first = ramp_time(min(entry, speed), max(entry, speed), acceleration, jerk)
    last = ramp_time(min(speed, exit_), max(speed, exit_), acceleration, jerk)
    cruise = distance - 0.5 * ((entry + speed) * first + (speed + exit_) * last)
    return first + last + cruise / speed, cruise


@compiled
def _put_moves(
    moves: Array, cruises: tuple[float, float, float], speeds: tuple[float, float, float], limits: Array
) -> int:
    """Write cruises at three speeds [m], with ramps between them; return how many moves there are."""
    at = 0
    dust = _DUST * (cruises[0] + cruises[1] + cruises[2])
    for place in range(3):
        if cruises[place] > dust:
            at = put_cruise(moves, at, speeds[place], cruises[place])
        if place < 2 and speeds[place] != speeds[place + 1]:
            at = put_ramp(moves, at, speeds[place], speeds[place + 1], limits[1], limits[2])
    return at


@compiled
def _moves_about(
    moves: Array,
    distance: float,
    entry: float,
    exit_: float,
    limits: Array,
    duration: float,
    low: float,
    high: float,
) -> int:
    """Write the moves via a cruising speed with which they take ``duration``; return 0 without one.

    Args:
        limits: a row of a limit table. low, high: bracket of the speed: with ``low`` the moves take at least
            ``duration``, with ``high`` less, or the distance is too short for the ramps.
    """
    for _ in range(HALVINGS):
        speed = 0.5 * (low + high)
        took, cruise = _time_by(speed, distance, entry, exit_, limits[1], limits[2])
        if cruise >= 0.0 and took >= duration:
            low = speed
        else:
            high = speed
        if high - low <= _EXACT * high:
            break
    took, cruise = _time_by(low, distance, entry, exit_, limits[1], limits[2])
    if abs(took - duration) > SAME_TIME * (1.0 + duration):
        return 0
    return _put_moves(moves, (0.0, cruise, 0.0), (entry, low, exit_), limits)


@compiled
def _slower_moves(
    moves: Array, distance: float, entry: float, exit_: float, limits: Array, duration: float, later: float
) -> int:
    """Write moves that take longer than a cruise at the faster of the end speeds; return 0 without any.

    Args:
        later: by this time [s].
    """
    low, high = min(entry, exit_), max(entry, exit_)
    top = high
    if 0.0 < low < high:
        # cruise a part at the speed of one end, the rest at that of the other
        part = later / (1.0 / low - 1.0 / high)
        cruise = distance - 0.5 * (low + high) * ramp_time(low, high, limits[1], limits[2]) - part
        if cruise >= 0.0:
            before, after = (part, cruise) if entry == low else (cruise, part)
            return _put_moves(moves, (before, 0.0, after), (entry, entry, exit_), limits)
        top = low
    speed = top
    for _ in range(STEPS):
        speed *= STEP
        took, cruise = _time_by(speed, distance, entry, exit_, limits[1], limits[2])
        if cruise >= 0.0 and took >= duration:
            return _moves_about(moves, distance, entry, exit_, limits, duration, speed, speed / STEP)
    return 0


@compiled
def _moves_by_rows(
    moves: Array,
    spare: Array,
    distance: float,
    entry: float,
    exit_: float,
    table: Array,
    count: int,
    duration: float,
) -> int:
    """Write minimum-time moves with a lower top speed that nearly take ``duration``; return 0 without any."""
    found, best = np.empty((MAX_MOVES, MOVE)), 0
    capped = table.copy()
    low, high = max(entry, exit_), table[count - 1, 0]
    least = 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        rows = 1
        while rows < count and table[rows - 1, 0] < middle:
            rows += 1
        for row in range(rows):
            capped[row, 0] = min(table[row, 0], middle)
        made = min_time_moves(found, spare, distance, entry, exit_, capped, rows)
        took = duration_of_moves(found, made) if made > 0 else 2.0 * duration
        if took <= duration:
            best, high, least = made, middle, took
            moves[:made] = found[:made]
        else:
            low = middle
        if high - low <= _EXACT * high:
            break
    return best if duration - least <= SAME_TIME_BY_ROWS * max(1.0, duration) else 0


@compiled
def moves_in_time(
    moves: Array,
    spare: Array,
    distance: float,
    entry: float,
    exit_: float,
    table: Array,
    count: int,
    duration: float,
) -> tuple[int, int]:
    """Write moves over ``distance`` from ``entry`` to ``exit_`` that take ``duration``, else the fastest.

    Args:
        moves, spare: shape (`MAX_MOVES`, `MOVE`), written. table, count: the limit table and its rows.

    Returns:
        The number of moves, 0 where none exist between these speeds; and `KEPT`, `LATE` or `EARLY`.
    """
    slack = SAME_TIME * (1.0 + duration)
    high = max(entry, exit_)
    if entry == exit_ and entry > 0.0 and abs(distance / entry - duration) <= SAME_TIME * duration:
        return put_cruise(moves, 0, entry, distance), KEPT
    made = min_time_moves(moves, spare, distance, entry, exit_, table, count)
    least = duration_of_moves(moves, made)
    if made == 0 or least >= duration - slack:
        return made, KEPT if made > 0 and least <= duration + slack else LATE
    start = 0
    while start < count - 1 and table[start, 0] < high * (1.0 - 1e-12):
        start += 1
    found = 0
    at_high = np.inf
    if high > 0.0:
        at_high, cruise = _time_by(high, distance, entry, exit_, table[start, 1], table[start, 2])
        at_high = at_high if cruise >= 0.0 else 0.0
    if at_high >= duration:
        for row in range(start, count):
            top = max(table[row, 0], high)
            took, cruise = _time_by(top, distance, entry, exit_, table[row, 1], table[row, 2])
            if cruise >= 0.0 and took > duration:
                continue
            found = _moves_about(spare, distance, entry, exit_, table[row], duration, high, top)
            if found > 0:
                break
    else:
        found = _slower_moves(
            spare, distance, entry, exit_, table[start], duration, duration - max(at_high, 0.0)
        )
    if found > 0:
        moves[:found] = spare[:found]
        return found, KEPT
    quickest = moves[:made].copy()
    found = _moves_by_rows(moves, spare, distance, entry, exit_, table, count, duration)
    if found > 0:
        return found, KEPT
    moves[:made] = quickest
    return made, EARLY


@compiled
def group_in_time(
    moves: Array, spare: Array, run: Run, group: int, ends: tuple[float, float, float], duration: float
) -> tuple[int, int]:
    """Write the moves of one group of a run, as `moves_in_time` does.

    Args:
        ends: its length, and the speeds at its start and end.
    """
    distance, entry, exit_ = ends
    table = np.empty((MAX_TABLE_ROWS, 3))
    made, timing = 0, LATE
    quickest = moves[:0].copy()
    # the knots' speeds were found with or without the rows for vertices: try both tables
    for lower in (0.0, np.inf):
        count = make_limit_table(run, group, group + 1, lower, table)
        found, timing_now = moves_in_time(moves, spare, distance, entry, exit_, table, count, duration)
        if timing_now == KEPT:
            return found, KEPT
        if made == 0 and found > 0:
            made, timing = found, timing_now
            quickest = moves[:found].copy()
    moves[:made] = quickest
    return made, timing


@compiled
def timing_of_group(run: Run, group: int, ends: tuple[float, float, float], duration: float) -> int:
    """Return the timing of a group, `KEPT`, `LATE` or `EARLY`; `LATE` where no moves exist."""
    moves, spare = np.empty((MAX_MOVES, MOVE)), np.empty((MAX_MOVES, MOVE))
    return group_in_time(moves, spare, run, group, ends, duration)[1]
