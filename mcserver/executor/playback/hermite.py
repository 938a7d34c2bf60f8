"""Interpolation between two setpoint rows: cubic Hermite, except where the cubic would overshoot a rest."""

from __future__ import annotations

import numpy as np

from mcserver.executor.headroom import Array


def between_rows(
    start: Array, end: Array, start_speed: Array, end_speed: Array, share: float, seconds: float
) -> tuple[Array, Array]:
    """Return position and velocity at ``share`` of the interval between two rows.

    Args:
        start, end: positions, shape (K,) [m, rad]. start_speed, end_speed: velocities there [per s].
        seconds: time between the rows [s].

    Returns:
        Shape (K,) each. Cubic Hermite; for axes that are at rest at one of the rows see `_rest_within`.
    """
    left = 1.0 - share
    displacement = end - start
    position = (
        start
        + (share * share * (3.0 - 2.0 * share)) * displacement
        + (seconds * share * left * left) * start_speed
        - (seconds * share * share * left) * end_speed
    )
    velocity = (
        (6.0 * share * left / seconds) * displacement
        + (left * (1.0 - 3.0 * share)) * start_speed
        + (share * (3.0 * share - 2.0)) * end_speed
    )
    if not (start_speed * end_speed).any():
        speed = start_speed + end_speed
        for column in np.nonzero(np.abs(speed) * seconds > 3.0 * np.abs(displacement))[0].tolist():
            if start_speed[column] * end_speed[column] == 0.0:
                gone, there = _rest_within(
                    float(displacement[column]),
                    float(speed[column]) * seconds,
                    share,
                    ending=bool(start_speed[column] != 0.0),
                )
                position[column] = start[column] + gone
                velocity[column] = there / seconds
    return position, velocity


def _rest_within(displacement: float, reach: float, share: float, *, ending: bool) -> tuple[float, float]:
    """Return a motion that ends, or begins, between two rows.

    With one speed zero, the other v and the way d, a cubic is monotone up to v·dt = 3·d. Beyond that the
    motion is at rest for a part of the time; at constant acceleration it moves in the part 2·d/(v·dt).

    Args:
        reach: v·dt. ending: the rest is at the end, else at the beginning.

    Returns:
        The way gone, and the speed in ways a time between the rows.
    """
    part = max(0.0, 2.0 * displacement / reach)
    since_moving = share if ending else 1.0 - share
    left = max(0.0, 1.0 - since_moving / part) if part > 0.0 else 0.0
    gone = displacement * (1.0 - left * left)
    return (gone if ending else displacement - gone), reach * left
