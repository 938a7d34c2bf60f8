"""The rows about u that a change of the playback rate is tried on, and the limits of axes that move there.

Nothing is copied: rows are read where they stand in the ring. Time in cycles, u in rows.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.rate_changes import NEAR_U

# What an axis may move in a cycle on an edge on which its rows are at rest [m, rad].
AT_REST = 1e-12

# Columns of the state that is asked about: u, the rate and its slope; the rate that is wished for, and the u
# before which the motion has to be able to stop (infinite: none); the rows that the longest stop takes; the
# first cycle's length [s]; u where the motion began; the rows that u passed in the last cycle; the safe rate,
# at which all rows ahead may be played; u from which on a higher one is safe (infinite: none), and that rate.
U, NOW, BEND, TARGET, EDGE, FAR, SECONDS, BEGUN, PASSED, SAFE, HIGHER_FROM, HIGHER = range(12)
STATE = 12
# Rows of the limits of each axis: the greatest differences of its setpoints, the same for what a change of
# rate is made with, and the two bounds of interpolation.
VELOCITY, ACCELERATION, JERK, RAW_ACCELERATION, RAW_JERK, BOUNDS = range(6)
LIMITS = BOUNDS + 2
# Rows of the scratch for each axis: limits of this search, speed, the last setpoint and its differences, the
# place now, and the bounds of interpolation at the pace there.
LIMIT, SPEED, SETPOINT, FIRST, SECOND, PLACE, BOUNDS_HERE, STILL = 0, 3, 4, 5, 6, 7, 8, 10
SCRATCH = 11


@compiled
def find_window(
    row_u: NDArray[np.int64],
    position: Array,
    velocity: Array,
    first: int,
    last: int,
    from_rest: bool,
    begun: float,
    driven: NDArray[np.bool_],
    limits: Array,
    seconds: float,
    places: Array,
    at: NDArray[np.int64],
) -> tuple[int, bool]:
    """Write u and the place in the ring of rows first to last - 1, and where the axes rest between them.

    From where a motion stands at its beginning, or after a gap, to the next row it goes from rest: such a
    place is noted as -1 - (the row it rests at), that of the beginning as -1 - n. Rows behind which an axis
    moves by itself before the next one, as by a rapid, are the last: u waits there for it.

    Returns:
        The number of places, and whether such a rest is the last of them.
    """
    size = len(row_u)
    count = 0
    for number in range(first, last):
        here = float(row_u[number % size])
        if number > first and _moves_by_itself(
            position, velocity, (number - 1) % size, number % size, driven, limits, seconds
        ):
            return count, True
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
    return count, False


@compiled
def _moves_by_itself(
    position: Array,
    velocity: Array,
    before: int,
    after: int,
    driven: NDArray[np.bool_],
    limits: Array,
    seconds: float,
) -> bool:
    """Return whether rows rest, and an axis is farther away in the next one than a motion from rest gets."""
    for k in range(position.shape[1]):
        if velocity[before, k] != 0.0:
            return False
    for k in range(position.shape[1]):
        moved = abs(position[after, k] - position[before, k])
        if driven[k] and moved > abs(velocity[after, k]) * seconds + 0.25 * limits[RAW_ACCELERATION, k]:
            return True
    return False


@compiled
def row_position(position: Array, start: Array, at: int) -> Array:
    """Return the positions at a place of the window."""
    row = start
    if at >= 0:
        row = position[at]
    elif -1 - at < len(position):
        row = position[-1 - at]
    return row


@compiled
def row_velocity(velocity: Array, still: Array, at: int) -> Array:
    """Return the velocities at a place of the window."""
    row = still
    if at >= 0:
        row = velocity[at]
    return row


@compiled
def set_limits(
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
        scratch[LIMIT, k] = math.inf
        wanted += driven[k]
        if driven[k] and displaced[k]:
            scratch[LIMIT, k] = 0.0
            moving += 1
    for number in range(first, last):
        if moving == wanted:
            break
        row = velocity[number % size]
        for k in range(width):
            if row[k] != 0.0 and driven[k] and scratch[LIMIT, k] != 0.0:
                scratch[LIMIT, k] = 0.0
                moving += 1
    for k in range(width):
        moves = scratch[LIMIT, k] == 0.0
        for order in range(3):
            scratch[LIMIT + order, k] = limits[VELOCITY + order, k] if moves else math.inf
        if urgent:
            scratch[LIMIT + 2, k] = math.inf


@compiled
def rests_at(
    velocity: Array, places: Array, at: NDArray[np.int64], count: int, scratch: Array, state: Array
) -> bool:
    """Return whether the rows come to rest by themselves on the edge."""
    found = False
    for i in range(count):
        if abs(places[i] - state[EDGE]) < NEAR_U:
            found = True
            row = row_velocity(velocity, scratch[STILL], at[i])
            for k in range(len(row)):
                if not math.isinf(scratch[LIMIT, k]) and abs(row[k]) * state[SECONDS] > AT_REST:
                    return False
    return found
