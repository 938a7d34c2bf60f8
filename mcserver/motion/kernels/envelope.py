"""Setpoints against the envelope of an approved run."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Answers of `find_excess`: none, or twice the column, plus FAST where it is the speed.
INSIDE, FAST = -1, 1
# What rounding may add.
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
        low, high: bounds, step: greatest distance, shape (K,) [m or rad]. factor: of all steps.
        bounded: columns whose positions count. followed: those whose steps do.
    """
    for column in range(len(setpoint)):
        here = setpoint[column]
        if bounded[column] and not (low[column] - _ROUNDING <= here <= high[column] + _ROUNDING):
            return 2 * column
        if followed[column] and not abs(here - before[column]) <= factor * step[column] + _ROUNDING:
            return 2 * column + 1
    return -1


@compiled
def tip_positions(steps: Array, turning: NDArray[np.bool_], joints: Array) -> Array:
    """Return where a tool's tip is, shape (n, 3) [m].

    Args:
        steps: shape (K + 1, 3, 4), from the base to the first joint's frame, from frame to frame, to the
        tool; each frame's z is its joint's axis. turning: shape (K,), False for joints that slide.
        joints: shape (n, K) [rad or m].
    """
    found = np.empty((len(joints), 3))
    frame, following = np.empty((3, 4)), np.empty((3, 4))
    for at in range(len(joints)):
        frame[:] = steps[0]
        for joint in range(len(turning)):
            value = joints[at, joint]
            if turning[joint]:
                cosine, sine = math.cos(value), math.sin(value)
                for row in range(3):
                    x, y = frame[row, 0], frame[row, 1]
                    frame[row, 0] = cosine * x + sine * y
                    frame[row, 1] = cosine * y - sine * x
            else:
                for row in range(3):
                    frame[row, 3] += value * frame[row, 2]
            step = steps[joint + 1]
            for row in range(3):
                for column in range(4):
                    total = frame[row, 3] if column == 3 else 0.0
                    for inner in range(3):
                        total += frame[row, inner] * step[inner, column]
                    following[row, column] = total
            frame[:] = following
        found[at, 0], found[at, 1], found[at, 2] = frame[0, 3], frame[1, 3], frame[2, 3]
    return found
