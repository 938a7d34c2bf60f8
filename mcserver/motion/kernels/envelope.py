"""Check setpoints against the envelope of an approved run."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Results: INSIDE, or 2 · index where a position is outside, 2 · index + FAST where a speed is. The index is
# the column, for rows row · axes + column.
INSIDE, FAST = -1, 1
# Tolerance for rounding.
_ROUNDING = 1e-12


@compiled
def find_excess(
    setpoint: Array,
    before: Array,
    low: Array,
    high: Array,
    step: Array,
    factor: float,
    bounded: NDArray[np.bool_],
    followed: NDArray[np.bool_],
) -> int:
    """Return the first column whose setpoint is outside or too far from the one before.

    Args:
        setpoint, before: of this cycle and of the one before, shape (K,) [m or rad].
        low, high: bounds of positions. step: greatest change in a cycle, shape (K,) [m or rad]. factor:
            multiplies all steps.
        bounded: columns whose positions are checked. followed: columns whose steps are checked.
    """
    for column in range(len(setpoint)):
        here = setpoint[column]
        if bounded[column] and not (low[column] - _ROUNDING <= here <= high[column] + _ROUNDING):
            return 2 * column
        if followed[column] and not abs(here - before[column]) <= factor * step[column] + _ROUNDING:
            return 2 * column + 1
    return -1


@compiled
def find_wrong_row(
    position: Array,
    velocity: Array,
    driven: NDArray[np.uint64],
    feed_scale: Array,
    first: int,
    written: int,
    low: Array,
    high: Array,
    speed: Array,
) -> int:
    """Return the first of a ring's rows ``first`` to ``written`` - 1 that is outside, counted from ``first``.

    Args:
        position, velocity, driven, feed_scale: of the ring, as in `ProgramRing`.
        low, high, speed: bounds at an override of 100 %, shape (K,) [m or rad, per s].
    """
    rows, axes = position.shape
    for number in range(first, written):
        at = number % rows
        for column in range(axes):
            if not driven[at] >> np.uint64(column) & np.uint64(1):
                continue
            place: int = (number - first) * axes + column
            if not low[column] <= position[at, column] <= high[column]:
                return 2 * place
            if not abs(velocity[at, column]) / feed_scale[at] <= speed[column]:
                return 2 * place + 1
    return -1


@compiled
def tip_positions(steps: Array, turning: NDArray[np.bool_], joints: Array) -> Array:
    """Return the positions of a tool's tip, shape (n, 3) [m].

    Args:
        steps: transforms from the base to the first joint's frame, from frame to frame, and to the tool,
            shape (K + 1, 3, 4); each frame's z is its joint's axis. turning: False for prismatic joints,
            shape (K,).
        joints: shape (n, K) [rad or m].
    """
    found = np.empty((len(joints), 3))
    for at in range(len(joints)):
        for row in range(3):
            # each row of a transform is multiplied through the chain independently
            x, y, z, p = steps[0, row, 0], steps[0, row, 1], steps[0, row, 2], steps[0, row, 3]
            for joint in range(len(turning)):
                value = joints[at, joint]
                if turning[joint]:
                    cosine, sine = math.cos(value), math.sin(value)
                    x, y = cosine * x + sine * y, cosine * y - sine * x
                else:
                    p += value * z
                step = steps[joint + 1]
                p += x * step[0, 3] + y * step[1, 3] + z * step[2, 3]
                x, y, z = (
                    x * step[0, 0] + y * step[1, 0] + z * step[2, 0],
                    x * step[0, 1] + y * step[1, 1] + z * step[2, 1],
                    x * step[0, 2] + y * step[1, 2] + z * step[2, 2],
                )
            found[at, row] = p
    return found


@compiled
def find_tip_outside(
    steps: Array,
    turning: NDArray[np.bool_],
    columns: NDArray[np.intp],
    position: Array,
    driven: NDArray[np.uint64],
    setpoint: Array,
    first: int,
    written: int,
    low: Array,
    high: Array,
) -> int:
    """Return the first of a ring's rows at which a tool's tip is outside, counted from ``first``, or INSIDE.

    Args:
        steps, turning: as in `tip_positions`. columns: of its joints.
        position, driven: of the ring. setpoint: of axes that a row does not drive, shape (K,) [m or rad].
        low, high: of the box of the tip, X, Y and Z [m].
    """
    joints = np.empty((1, len(columns)))
    for number in range(first, written):
        at = number % len(position)
        for joint in range(len(columns)):
            column = columns[joint]
            drives = driven[at] >> np.uint64(column) & np.uint64(1)
            joints[0, joint] = position[at, column] if drives else setpoint[column]
        tip = tip_positions(steps, turning, joints)
        for place in range(3):
            if not low[place] <= tip[0, place] <= high[place]:
                return number - first
    return -1
