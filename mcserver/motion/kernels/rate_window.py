"""The rows around u on which a change of the playback rate is tried, and the limits of the axes there.

Rows are read in place in the ring. Time in cycles, u in rows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.rate_changes import NEAR_U

# Rows are at rest at an edge if no axis moves by more than this in a cycle there [m, rad].
AT_REST = 1e-12
# Limits of each axis: greatest differences of its setpoints; acceleration and jerk for planning a change of
# rate; and the two bounds of interpolation.
VELOCITY, ACCELERATION, JERK, RAW_ACCELERATION, RAW_JERK, BOUNDS = range(6)
LIMITS = BOUNDS + 2
# Memory for each axis: limits of this search, speed, the last setpoint and its differences, the present
# position, and zeros.
LIMIT, SPEED, SETPOINT, FIRST, SECOND, PLACE, STILL = 0, 3, 4, 5, 6, 7, 8
MEMORY = 9


class RingRows(NamedTuple):
    """Rows of a ring of n: u, shape (n,), position and velocity, (n, K), and torque, (n, 3, J), of the J
    joints with limited torque (`row_torques`).
    """

    u: NDArray[np.int64]
    position: Array
    velocity: Array
    torque: Array


class Window(NamedTuple):
    """The rows for the setpoints to come, and the last setpoints.

    Attributes:
        first, behind: number of the first row, and of the row after the last. from_rest: the first row is the
            first of the motion, which goes there from rest. ends: the motion rests at the last row.
        begun: u where the motion began. start: positions there, shape (K,).
        driven: axes that rows drive, shape (K,). displaced: axes that have left the position where their
            motion began, shape (K,).
        recent: setpoints of the last three cycles, the newest last, shape (3, K).
    """

    first: int
    behind: int
    from_rest: bool
    ends: bool
    begun: float
    start: Array
    driven: NDArray[np.bool_]
    displaced: NDArray[np.bool_]
    recent: Array


class RateState(NamedTuple):
    """The rate at the beginning of a cycle, and the order for it.

    Attributes:
        u: on the program's time axis. rate, slope: now [1, 1/cycle]. target: ordered rate, 0 to 1.
        edge: u before which the motion has to be able to stop; infinite: none.
        far: rows before the edge within which a stop is planned. seconds: length of a cycle [s].
        passed: rows in the last cycle.
    """

    u: float
    rate: float
    slope: float
    target: float
    edge: float
    far: float
    seconds: float
    passed: float


class Places(NamedTuple):
    """Rows and rests of a window in order of u, as `find_window` writes them.

    Attributes:
        u, at: shape (2 n + 2,), of which the first ``length`` are valid. ends: whether motion is at rest
            after the last.
    """

    u: Array
    at: NDArray[np.int64]
    length: int
    ends: bool


class Change(NamedTuple):
    """A change of the rate: phases (`rate_changes`), of which the first ``length`` are valid, and the final
    rate.
    """

    phases: Array
    length: int
    target: float


@compiled
def find_window(
    rows: RingRows, window: Window, limits: Array, seconds: float, u: Array, at: NDArray[np.int64]
) -> Places:
    """Write u and ring index of the rows of a window, and of the rests between them.

    The beginning of a motion and a gap between rows are rests, from which motion goes to the next row. A rest
    has the index -1 - (index of the row it rests at), the beginning -1 - n. The window ends before a row that
    an axis reaches by itself, as by a rapid: u waits there for it.

    Args:
        seconds: length of a cycle [s]. u, at: memory for the places.
    """
    size = len(rows.u)
    count = 0
    for number in range(window.first, window.behind):
        here = float(rows.u[number % size])
        if number > window.first and _moves_by_itself(
            rows, (number - 1) % size, number % size, window.driven, limits, seconds
        ):
            return Places(u, at, count, True)
        if number == window.first and window.from_rest:
            u[0] = min(max(here - 1.0, window.begun), here - NEAR_U)
            at[0] = -1 - size
            count = 1
        elif number > window.first and here - u[count - 1] > 1.0 + NEAR_U:
            # at rest until a cycle before the next row
            u[count] = here - 1.0
            at[count] = -1 - (number - 1) % size
            count += 1
        u[count] = here
        at[count] = number % size
        count += 1
    return Places(u, at, count, window.ends)


@compiled
def _moves_by_itself(
    rows: RingRows, before: int, after: int, driven: NDArray[np.bool_], limits: Array, seconds: float
) -> bool:
    """Return whether rows rest, and the next row is farther away than a motion from rest would get."""
    position, velocity = rows.position, rows.velocity
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
    """Return the positions at an index of `Places.at`."""
    row = start
    if at >= 0:
        row = position[at]
    elif -1 - at < len(position):
        row = position[-1 - at]
    return row


@compiled
def row_velocity(velocity: Array, still: Array, at: int) -> Array:
    """Return the velocities at an index of `Places.at`; zero at a rest."""
    row = still
    if at >= 0:
        row = velocity[at]
    return row


@compiled
def set_limits(rows: RingRows, window: Window, limits: Array, urgent: bool, memory: Array) -> None:
    """Write the limits of the setpoints' differences.

    Infinite for axes that do not move in the window, and for jerk where the stop is urgent.
    """
    velocity, driven, displaced = rows.velocity, window.driven, window.displaced
    width, size = velocity.shape[1], len(velocity)
    moving = 0
    wanted = 0
    for k in range(width):
        memory[LIMIT, k] = math.inf
        wanted += driven[k]
        if driven[k] and displaced[k]:
            memory[LIMIT, k] = 0.0
            moving += 1
    for number in range(window.first, window.behind):
        if moving == wanted:
            break
        row = velocity[number % size]
        for k in range(width):
            if row[k] != 0.0 and driven[k] and memory[LIMIT, k] != 0.0:
                memory[LIMIT, k] = 0.0
                moving += 1
    for k in range(width):
        moves = memory[LIMIT, k] == 0.0
        for order in range(3):
            memory[LIMIT + order, k] = limits[VELOCITY + order, k] if moves else math.inf
        if urgent:
            memory[LIMIT + 2, k] = math.inf


@compiled
def rests_at_edge(rows: RingRows, places: Places, edge: float, seconds: float, memory: Array) -> bool:
    """Return whether the rows come to rest by themselves on the edge."""
    found = False
    for i in range(places.length):
        if abs(places.u[i] - edge) < NEAR_U:
            found = True
            row = row_velocity(rows.velocity, memory[STILL], places.at[i])
            for k in range(len(row)):
                if not math.isinf(memory[LIMIT, k]) and abs(row[k]) * seconds > AT_REST:
                    return False
    return found
