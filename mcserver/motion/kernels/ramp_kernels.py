"""Speed ramps with zero acceleration at both ends, and minimum-time sequences of them over a distance.

A *move* is one row of `MOVE` numbers: speed at its start and end, acceleration and jerk that it may use, and
its length. A move of equal speeds is a cruise. A *limit table* is an array (n, 3) of rows, increasing in
speed: a speed, and the acceleration and jerk that are available up to it.
"""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

MOVE = 5
# At most two ramps per row, and three moves at the peak.
MAX_TABLE_ROWS = 12
MAX_MOVES = 2 * MAX_TABLE_ROWS + 4
# Distances below this are not motion [m or rad along the path]: far under any encoder's resolution.
NO_DISTANCE = 1e-12
# Relative tolerance of a speed found by iteration.
_EXACT = 1e-15
# Relative margin of a speed that must not need more than the distance.
_ROUNDED = 1e-14


@compiled
def ramp_time(low: float, high: float, acceleration: float, jerk: float) -> float:
    """Return the least time of a ramp from ``low`` to ``high`` with zero acceleration at both ends [s]."""
    change = high - low
    if change <= 0.0:
        return 0.0
    if math.isinf(jerk):
        return change / acceleration
    if change * jerk >= acceleration * acceleration:
        return change / acceleration + acceleration / jerk
    return 2.0 * math.sqrt(change / jerk)


@compiled
def ramp_distance(low: float, high: float, acceleration: float, jerk: float) -> float:
    """Return the distance of a ramp of `ramp_time` [m]; by symmetry its mean speed is that of the ends."""
    return (low + high) / 2.0 * ramp_time(low, high, acceleration, jerk)


@compiled
def _larger_root(b: float, c: float) -> float:
    """Return the positive v with v² + b v = c, for b ≥ 0 and c ≥ 0, without cancellation."""
    return 2.0 * c / (b + math.sqrt(b * b + 4.0 * c)) if c > 0.0 else 0.0


@compiled
def reachable_speed(low: float, distance: float, acceleration: float, jerk: float, cap: float) -> float:
    """Return the greatest speed ≤ ``cap`` reached from ``low`` within ``distance``, with zero acceleration at
    both ends."""
    if cap <= low:
        return low
    if ramp_distance(low, cap, acceleration, jerk) <= distance:
        return cap
    # with b = a²/j and a phase of constant acceleration: v² + b v = v0² + 2 a d - b v0, where b = 0 without
    # a jerk limit
    part = 0.0 if math.isinf(jerk) else acceleration * acceleration / jerk
    speed = _larger_root(part, low * low + 2.0 * acceleration * distance - part * low)
    if speed - low < part:
        # without that phase, w = √(v - v0) solves w³ + 2 v0 w = d √j; the left side is convex, so Newton's
        # method descends to the root from any point above it
        right = distance * math.sqrt(jerk)
        w = right ** (1.0 / 3.0)
        if low > 0.0:
            w = min(w, right / (2.0 * low))
        for _ in range(60):
            change = (w * (w * w + 2.0 * low) - right) / (3.0 * w * w + 2.0 * low)
            w -= change
            if change <= _EXACT * w:
                break
        speed = low + w * w
    return min(max(speed * (1.0 - _ROUNDED), low), cap)


@compiled
def _choices(count: int) -> int:
    """Return the number of selections of a limit table's rows that are tried."""
    return 3 if count > 2 else 1


@compiled
def _rows_of_choice(choice: int, count: int) -> tuple[int, int]:
    """Return the first row and the step of a selection: all rows, every other one, the top row alone."""
    return (0, 1) if choice == 0 else (1, 2) if choice == 1 else (count - 1, 1)


@compiled
def _speed_by_rows(
    low: float, distance: float, limit_table: Array, first: int, step: int, count: int, cap: float
) -> float:
    speed, left = low, distance
    for index in range(first, count, step):
        if limit_table[index, 0] <= speed:
            continue
        target = min(limit_table[index, 0], cap)
        need = ramp_distance(speed, target, limit_table[index, 1], limit_table[index, 2])
        if need > left:
            return reachable_speed(speed, left, limit_table[index, 1], limit_table[index, 2], target)
        speed, left = target, left - need
        if speed >= cap:
            break
    return speed


@compiled
def reachable_speed_by_table(
    low: float, distance: float, limit_table: Array, count: int, cap: float
) -> float:
    """Return the greatest speed ≤ ``cap`` that `min_time_moves` reaches from ``low`` within ``distance``."""
    best = low
    for choice in range(_choices(count)):
        first, step = _rows_of_choice(choice, count)
        best = max(best, _speed_by_rows(low, distance, limit_table, first, step, count, cap))
    return best


@compiled
def put_ramp(moves: Array, at: int, start: float, end: float, acceleration: float, jerk: float) -> int:
    moves[at, 0] = start
    moves[at, 1] = end
    moves[at, 2] = acceleration
    moves[at, 3] = jerk
    moves[at, 4] = ramp_distance(min(start, end), max(start, end), acceleration, jerk)
    return at + 1


@compiled
def put_cruise(moves: Array, at: int, speed: float, length: float) -> int:
    moves[at, 0] = speed
    moves[at, 1] = speed
    moves[at, 2] = 0.0
    moves[at, 3] = 0.0
    moves[at, 4] = length
    return at + 1


@compiled
def duration_of_moves(moves: Array, count: int) -> float:
    """Return the duration of moves [s]."""
    total = 0.0
    for index in range(count):
        start, end = moves[index, 0], moves[index, 1]
        if start == end:
            total += moves[index, 4] / start
        else:
            total += ramp_time(min(start, end), max(start, end), moves[index, 2], moves[index, 3])
    return total


@compiled
def _peak_need(peak: float, entry: float, exit_: float, acceleration: float, jerk: float) -> float:
    return ramp_distance(entry, peak, acceleration, jerk) + ramp_distance(exit_, peak, acceleration, jerk)


@compiled
def _slope(low: float, high: float, acceleration: float, jerk: float) -> float:
    """Return the derivative of `ramp_distance` by ``high``."""
    change = high - low
    if change <= 0.0:
        return math.inf
    if math.isinf(jerk):
        return high / acceleration
    if change * jerk >= acceleration * acceleration:
        return high / acceleration + acceleration / (2.0 * jerk)
    time = math.sqrt(change / jerk)
    return time + (low + high) / (2.0 * time * jerk)


@compiled
def _peak(
    low: float, high: float, distance: float, entry: float, exit_: float, acceleration: float, jerk: float
) -> float:
    """Return the greatest speed between ``low``, which can be reached, and ``high``, which cannot."""
    x = (low + high) / 2.0
    # Newton kept inside a bisection: the distance has an infinite slope where a ramp begins
    for _ in range(100):
        over = _peak_need(x, entry, exit_, acceleration, jerk) - distance
        if over <= 0.0:
            low = x
        else:
            high = x
        if high - low <= _EXACT * high:
            break
        slope = _slope(entry, x, acceleration, jerk) + _slope(exit_, x, acceleration, jerk)
        new = x - over / slope
        if abs(new - x) <= _EXACT * x:
            # the iteration converges from above, so round down
            return max(new * (1.0 - _ROUNDED), low)
        x = new if low < new < high else (low + high) / 2.0
    return low


@compiled
def peak_moves(
    moves: Array,
    at: int,
    distance: float,
    entry: float,
    exit_: float,
    top: float,
    acceleration: float,
    jerk: float,
) -> int:
    """Write a ramp up to the greatest speed ≤ ``top`` that the distance allows, a cruise, and a ramp down.

    With zero acceleration at both ends this is the quickest way.

    Returns:
        How many moves there are now; −1 where the speeds cannot be joined over the distance.
    """
    low = max(entry, exit_)
    if ramp_distance(min(entry, exit_), low, acceleration, jerk) > distance * (1.0 + 1e-12):
        return -1
    need = _peak_need(top, entry, exit_, acceleration, jerk)
    if need > distance:
        top = _peak(low, top, distance, entry, exit_, acceleration, jerk)
        need = _peak_need(top, entry, exit_, acceleration, jerk)
    first = at
    if top > entry:
        at = put_ramp(moves, at, entry, top, acceleration, jerk)
    left = distance - need
    if left > NO_DISTANCE * max(1.0, distance):
        if top <= 0.0:
            return -1
        at = put_cruise(moves, at, top, left)
    if top > exit_:
        at = put_ramp(moves, at, top, exit_, acceleration, jerk)
    return at if at > first else -1


@compiled
def _table_moves(
    moves: Array,
    distance: float,
    entry: float,
    exit_: float,
    limit_table: Array,
    first: int,
    step: int,
    count: int,
) -> int:
    """Write ramps from row to row on both sides as far as the distance allows, and a peak between them."""
    high = max(entry, exit_)
    start = -1
    for index in range(first, count, step):
        if limit_table[index, 0] >= high * (1.0 - 1e-12):
            start = index
            break
    if start < 0:
        return 0
    last = first + (count - 1 - first) // step * step
    tail = np.empty((MAX_TABLE_ROWS, MOVE))
    at, tails = 0, 0
    up, down, left = entry, exit_, distance
    row = last
    for index in range(first, count, step):
        speed, acceleration, jerk = limit_table[index, 0], limit_table[index, 1], limit_table[index, 2]
        if speed <= min(up, down) or index == last:
            continue
        need = ramp_distance(up, speed, acceleration, jerk) + ramp_distance(down, speed, acceleration, jerk)
        if need > left * (1.0 - 1e-9):
            row = index
            break
        if up < speed:
            at = put_ramp(moves, at, up, speed, acceleration, jerk)
            up = speed
        if down < speed:
            tails = put_ramp(tail, tails, speed, down, acceleration, jerk)
            down = speed
        left -= need
    if left <= NO_DISTANCE:
        if up != down:
            return 0
    else:
        # the peak may have to exceed the row of the faster end
        row = max(row, start)
        top = max(limit_table[row, 0], up, down)
        at = peak_moves(moves, at, left, up, down, top, limit_table[row, 1], limit_table[row, 2])
        if at < 0:
            return 0
    for index in range(tails - 1, -1, -1):
        moves[at] = tail[index]
        at += 1
    return at


@compiled
def _ramps_only(
    moves: Array,
    distance: float,
    entry: float,
    exit_: float,
    limit_table: Array,
    first: int,
    step: int,
    count: int,
) -> int:
    """Write ramps from entry to exit, and a cruise at the greater speed over the remaining distance."""
    low, high = min(entry, exit_), max(entry, exit_)
    speed, left, at = low, distance, 0
    for index in range(first, count, step):
        if limit_table[index, 0] <= speed or speed >= high:
            continue
        target = min(limit_table[index, 0], high)
        at = put_ramp(moves, at, speed, target, limit_table[index, 1], limit_table[index, 2])
        left -= moves[at - 1, 4]
        speed = target
    if speed < high or left < 0.0 or high <= 0.0:
        return 0
    if left > NO_DISTANCE:
        at = put_cruise(moves, at, high, left)
    if entry > exit_:
        for index in range(at // 2):
            other = at - 1 - index
            for column in range(MOVE):
                moves[index, column], moves[other, column] = moves[other, column], moves[index, column]
        for index in range(at):
            moves[index, 0], moves[index, 1] = moves[index, 1], moves[index, 0]
    return at


@compiled
def min_time_moves(
    moves: Array, spare: Array, distance: float, entry: float, exit_: float, limit_table: Array, count: int
) -> int:
    """Write the minimum-time moves over ``distance`` from speed ``entry`` to ``exit_`` under a limit table.

    Acceleration is zero at each row that is used, so fewer rows may be faster: the whole limit table, every
    other row, and the top row alone are tried.

    Args:
        moves, spare: shape (`MAX_MOVES`, `MOVE`), written.

    Returns:
        The number of moves; 0 where no profile from entry to exit exists over this distance.
    """
    best, least = 0, math.inf
    for choice in range(_choices(count)):
        first, step = _rows_of_choice(choice, count)
        found = _table_moves(spare, distance, entry, exit_, limit_table, first, step, count)
        if found > 0:
            total = duration_of_moves(spare, found)
            if total < least:
                best, least = found, total
                moves[:found] = spare[:found]
    if best > 0:
        return best
    # where one ramp fills the whole distance, rounding may leave no peak
    for choice in range(_choices(count)):
        first, step = _rows_of_choice(choice, count)
        found = _ramps_only(moves, distance, entry, exit_, limit_table, first, step, count)
        if found > 0:
            return found
    return 0
