"""Interpolation between two setpoint rows, with no more acceleration than the motion that the rows sample.

Axes follow the cubic through positions and velocities, which is exact where jerk is constant. An axis without
a jerk limit may have a step of acceleration between rows, and about one of 2a the cubic accelerates by 1.5a:
where it would pass the limit, the axis follows the motion of least acceleration, ±M with one switch. Where a
motion begins or ends between the rows, and either would swing past the rest, it is at rest for a part of the
time.
"""

from __future__ import annotations

import numpy as np

from mcserver.executor.headroom import Array

# A cubic with one end at rest is monotone up to v·dt = 3·d, a motion of constant acceleration up to 2·d.
_CUBIC_MONOTONE, _CONSTANT_MONOTONE = 3.0, 2.0


def between_rows(
    start: Array,
    end: Array,
    start_velocity: Array,
    end_velocity: Array,
    share: Array | float,
    seconds: Array | float,
    most: Array,
) -> tuple[Array, Array]:
    """Return positions and velocities at ``share`` of the intervals between rows.

    Args:
        start, end: positions, shape (…, K) [m or rad]. start_velocity, end_velocity: there [per s].
        share: between 0 and 1, broadcast against them. seconds: between the rows [s], likewise.
        most: accelerations that the cubic may not pass, shape (K,) [per s²]; infinite for axes with a jerk
            limit.

    Returns:
        Shape (…, K) each [m or rad] and [per s].
    """
    displacement = end - start
    v0, v1 = start_velocity * seconds, end_velocity * seconds
    position, velocity = _cubic(displacement, v0, v1, share)
    bound = most * (seconds * seconds)
    excess = displacement - 0.5 * (v0 + v1)
    steep = 6.0 * np.abs(excess) + np.abs(v1 - v0) > bound * (1.0 + 1e-9)
    if steep.any():
        bang, bang_velocity = _least_acceleration(displacement, v0, v1, share)
        np.copyto(position, bang, where=steep)
        np.copyto(velocity, bang_velocity, where=steep)
    resting = (v0 == 0.0) != (v1 == 0.0)
    if resting.any():
        monotone = np.where(steep, _CONSTANT_MONOTONE, _CUBIC_MONOTONE)
        resting &= np.abs(v0 + v1) > monotone * np.abs(displacement)
        gone, moving = _rest_within(displacement, v0, v1, share)
        np.copyto(position, gone, where=resting)
        np.copyto(velocity, moving, where=resting)
    return start + position, velocity / seconds


def _cubic(displacement: Array, v0: Array, v1: Array, share: Array | float) -> tuple[Array, Array]:
    """Return displacement and velocity of the cubic, per interval."""
    left = 1.0 - share
    position = share * (share * (3.0 - 2.0 * share) * displacement + left * (left * v0 - share * v1))
    velocity = (
        6.0 * share * left * displacement + left * (1.0 - 3.0 * share) * v0 + share * (3.0 * share - 2.0) * v1
    )
    return position, velocity


def _least_acceleration(
    displacement: Array, v0: Array, v1: Array, share: Array | float
) -> tuple[Array, Array]:
    """Return displacement and velocity of the motion of least peak acceleration, per interval.

    With the change of speed w and e = d - (v0 + v1)/2: acceleration M on a part g of the time, then -M;
    M (2g - 1) = w and M g (1 - g) = e, so M = 2e ± √(4e² + w²) with the sign of e.
    """
    change = v1 - v0
    excess = displacement - 0.5 * (v0 + v1)
    most = 2.0 * excess + np.copysign(np.sqrt(4.0 * excess * excess + change * change), excess)
    part = 0.5 + 0.5 * change / np.where(most == 0.0, 1.0, most)
    left = 1.0 - share
    first = share <= part
    position = np.where(
        first, share * (v0 + 0.5 * most * share), displacement - left * (v1 + 0.5 * most * left)
    )
    return position, np.where(first, v0 + most * share, v1 + most * left)


def _rest_within(displacement: Array, v0: Array, v1: Array, share: Array | float) -> tuple[Array, Array]:
    """Return displacement and velocity of a motion that ends, or begins, between two rows, per interval.

    At constant acceleration it moves in the part 2·d/v of the time, and rests in the other.
    """
    speed = v0 + v1
    ending = v1 == 0.0
    part = np.maximum(2.0 * displacement / np.where(speed == 0.0, 1.0, speed), 1e-300)
    since = np.where(ending, share, 1.0 - share)
    left = np.maximum(0.0, 1.0 - since / part)
    gone = displacement * (1.0 - left * left)
    return np.where(ending, gone, displacement - gone), speed * left
