"""Many cycles of simulated servos at once (`mcserver.drives.servo_model`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled


@compiled
def follow_cycles(
    state: Array,
    coefficients: Array,
    limits: Array,
    follows: NDArray[np.int8],
    position: Array,
    velocity: Array,
    flush: tuple[int, int, float],
    cycle_s: float,
    moved: Array,
) -> int:
    """Let n axes follow setpoints for up to m cycles; results are bit-identical to single cycles.

    Args:
        state: shape (7, n), written: position, tracking error, velocity, old and new velocity setpoint,
            change of the velocity in the last cycle, last position setpoint.
        coefficients: of the loops, shape (2, 4, n). limits: largest change of a velocity in a cycle,
            largest velocity, and how far an axis in velocity mode is taken as off at most, shape (3, n).
        follows: shape (n,), 1: a position, 2: a velocity, 0: it stands. position, velocity: setpoints, shape
            (m, n).
        flush: cycles so far, after how many tiny values are set to zero, and what is tiny.
        moved: written: positions after each cycle, shape (m, n).

    Returns:
        The number of cycles before one in which an axis reaches a limit.
    """
    count, width = len(position), len(follows)
    done, every, tiny = flush
    errors, speeds, references = np.empty(width), np.empty(width), np.empty(width)
    for i in range(count):
        for k in range(width):
            wanted = velocity[i, k] if follows[k] else 0.0
            if follows[k] == 2:
                integral = state[6, k] + 0.5 * (state[3, k] + wanted) * cycle_s
                references[k] = state[0, k] - min(max(state[0, k] - integral, -limits[2, k]), limits[2, k])
            else:
                references[k] = position[i, k] if follows[k] else state[0, k]
            away = state[0, k] - references[k]
            error = coefficients[0, 0, k] * away
            error += coefficients[0, 1, k] * state[2, k]
            error += coefficients[0, 2, k] * state[3, k]
            error += coefficients[0, 3, k] * wanted
            speed = coefficients[1, 0, k] * away
            speed += coefficients[1, 1, k] * state[2, k]
            speed += coefficients[1, 2, k] * state[3, k]
            speed += coefficients[1, 3, k] * wanted
            if not (abs(speed - state[2, k]) <= limits[0, k] and abs(speed) <= limits[1, k]):
                return i
            errors[k], speeds[k] = error, speed
        done += 1
        for k in range(width):
            reference, wanted = references[k], velocity[i, k] if follows[k] else 0.0
            state[1, k] = state[0, k] - reference
            state[5, k] = speeds[k] - state[2, k]
            state[0, k] = reference + errors[k]
            state[2, k] = speeds[k]
            state[3, k] = state[4, k] = wanted
            state[6, k] = reference
            if done % every == 0:
                if abs(state[2, k]) < tiny:
                    state[2, k] = 0.0
                if abs(state[0, k]) < tiny:
                    state[0, k] = 0.0
            moved[i, k] = state[0, k]
    return count
