"""Interpolation between two setpoint rows, with no more acceleration than the motion that the rows sample.

Axes follow the cubic through positions and velocities, which is exact where jerk is constant. An axis without
a jerk limit may have a step of acceleration between rows, and about one of 2a the cubic accelerates by 1.5a:
where it would pass the limit, the axis follows the motion of least acceleration, ±M with one switch. Where a
motion begins or ends between the rows, and either would swing past the rest, it is at rest for a part of the
time.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# A cubic with one end at rest is monotone up to v·dt = 3·d, a motion of constant acceleration up to 2·d.
_CUBIC_MONOTONE, _CONSTANT_MONOTONE = 3.0, 2.0


@compiled
def _is_steep(displacement: float, v0: float, v1: float, bound: float) -> bool:
    """Return whether the cubic would accelerate by more than ``bound`` [per interval²]."""
    excess = displacement - 0.5 * (v0 + v1)
    return bool(6.0 * abs(excess) + abs(v1 - v0) > bound * (1.0 + 1e-9))


@compiled
def _special(displacement: float, v0: float, v1: float, share: float, bound: float) -> tuple[float, float]:
    """Return displacement and velocity, per interval, where the cubic may not be right."""
    steep = _is_steep(displacement, v0, v1, bound)
    monotone = _CONSTANT_MONOTONE if steep else _CUBIC_MONOTONE
    if (v0 == 0.0) != (v1 == 0.0) and abs(v0 + v1) > monotone * abs(displacement):
        return _rest_within(displacement, v0, v1, share)
    if steep:
        return _least_acceleration(displacement, v0, v1, share)
    return _cubic(displacement, v0, v1, share)


@compiled
def _cubic(displacement: float, v0: float, v1: float, share: float) -> tuple[float, float]:
    """Return displacement and velocity of the cubic, per interval."""
    left = 1.0 - share
    position = share * (share * (3.0 - 2.0 * share) * displacement + left * (left * v0 - share * v1))
    velocity = (
        6.0 * share * left * displacement + left * (1.0 - 3.0 * share) * v0 + share * (3.0 * share - 2.0) * v1
    )
    return position, velocity


@compiled
def _least_acceleration(displacement: float, v0: float, v1: float, share: float) -> tuple[float, float]:
    """Return displacement and velocity of the motion of least peak acceleration, per interval.

    With the change of speed w and e = d - (v0 + v1)/2: acceleration M on a part g of the time, then -M;
    M (2g - 1) = w and M g (1 - g) = e, so M = 2e ± √(4e² + w²) with the sign of e.
    """
    change = v1 - v0
    excess = displacement - 0.5 * (v0 + v1)
    most = 2.0 * excess + math.copysign(math.sqrt(4.0 * excess * excess + change * change), excess)
    part = 0.5 if most == 0.0 else 0.5 + 0.5 * change / most
    left = 1.0 - share
    if share <= part:
        return share * (v0 + 0.5 * most * share), v0 + most * share
    return displacement - left * (v1 + 0.5 * most * left), v1 + most * left


@compiled
def _rest_within(displacement: float, v0: float, v1: float, share: float) -> tuple[float, float]:
    """Return displacement and velocity of a motion that ends, or begins, between two rows, per interval.

    At constant acceleration it moves in the part 2·d/v of the time, and rests in the other.
    """
    speed = v0 + v1
    ending = v1 == 0.0
    part = max(2.0 * displacement / speed, 1e-300)
    since = share if ending else 1.0 - share
    left = max(0.0, 1.0 - since / part)
    gone = displacement * (1.0 - left * left)
    return (gone if ending else displacement - gone), speed * left


@compiled
def positions_between(
    start: Array,
    end: Array,
    start_velocity: Array,
    end_velocity: Array,
    share: float,
    seconds: float,
    most: Array,
    position: Array,
) -> None:
    """Write positions at ``share`` of the interval between two rows.

    Args:
        start, end: positions, shape (K,) [m or rad]. start_velocity, end_velocity: there [per s].
        share: between 0 and 1. seconds: between the rows [s].
        most: accelerations that the cubic may not pass, shape (K,) [per s²]; infinite for axes with a jerk
            limit.
        position: written, shape (K,).
    """
    left = 1.0 - share
    rise, first = share * share * (3.0 - 2.0 * share), share * left * left * seconds
    last = -share * share * left * seconds
    square = seconds * seconds * (1.0 + 1e-9)
    special = 0
    # two plain loops over all columns, which are vectorized; rows with more to them are rare
    for k in range(len(position)):
        displacement = end[k] - start[k]
        v0, v1 = start_velocity[k], end_velocity[k]
        position[k] = start[k] + (rise * displacement + first * v0 + last * v1)
        excess = displacement - 0.5 * seconds * (v0 + v1)
        steep = 6.0 * abs(excess) + seconds * abs(v1 - v0) > most[k] * square
        special |= steep | ((v0 == 0.0) != (v1 == 0.0))
    if special:
        for k in range(len(position)):
            displacement = end[k] - start[k]
            v0, v1 = start_velocity[k] * seconds, end_velocity[k] * seconds
            moved, _ = _special(displacement, v0, v1, share, most[k] * seconds * seconds)
            position[k] = start[k] + moved


@compiled
def interpolate_rows(
    rows: Array,
    velocities: Array,
    first: int,
    second: int,
    share: float,
    seconds: float,
    rate: float,
    most: Array,
    driven: NDArray[np.bool_],
    position: Array,
    velocity: Array,
) -> None:
    """Write setpoints and velocities of the driven columns between two rows of a ring.

    Args:
        rows, velocities: of the ring, shape (n, K) [m or rad, per s]. first, second: places in it.
        share, seconds, most: as of `positions_between`. rate: that velocities are scaled by [1].
        driven: shape (K,). position, velocity: written where driven, shape (K,).
    """
    for k in range(len(position)):
        if not driven[k]:
            continue
        displacement = rows[second, k] - rows[first, k]
        v0, v1 = velocities[first, k] * seconds, velocities[second, k] * seconds
        moved, speed = _special(displacement, v0, v1, share, most[k] * seconds * seconds)
        position[k] = rows[first, k] + moved
        velocity[k] = speed / seconds * rate
