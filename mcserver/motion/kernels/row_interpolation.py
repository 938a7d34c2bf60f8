"""Interpolation between two setpoint rows, with no more acceleration than the motion that the rows sample.

Axes follow the cubic through positions and velocities, which is exact where jerk is constant. An axis without
a jerk limit may have a step of acceleration between rows; at a step of 2a the cubic accelerates by 1.5a.
Where it would exceed the limit, the axis follows the motion of least acceleration, ±M with one switch.

At a sudden change near one of the rows the cubic overshoots: it turns back, and exceeds the speeds at both
rows. That happens where an exact path has a vertex, at which velocity steps (D-36), where a motion begins or
ends between the rows, and where an axis without a jerk limit begins or ends to accelerate. There velocity
changes monotonically, from one value to the other within a part of the time. So differences at the cycle rate
are at most those of the step itself, wherever the cycles fall, and nothing overshoots a rest or a greatest
speed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Bounds of interpolation: the acceleration that the cubic may not exceed, infinite for axes with a jerk
# limit, and the jerk that it exceeds only at a vertex, infinite for axes without a jerk limit. A jerk limit
# that lets acceleration go from one limit to the other within a cycle counts as infinite.
STEEP, SHARP = 0, 1
# Jerk of the cubic between two rows, in shares of the limit, above which there is a vertex between them. A
# motion that keeps the limit stays below 1.05. At a step of velocity that takes s times the jerk limit the
# cubic turns back with a jerk of more than 2 s, and overshoots by 18 %: so at most 0.75 * 1.18 of the limit
# pass undetected.
VERTEX_JERK = 1.5
# The same for the motion of least acceleration of an axis without a jerk limit.
VERTEX_ACCELERATION = 1.01
# Tolerance for rounding of a constant acceleration between two rows.
ONE_ACCELERATION = 1.001
# Powers of the remaining time by which the rest of a change of displacement falls, with constant jerk and
# with constant acceleration.
_CONSTANT_JERK, _CONSTANT_ACCELERATION = 3, 2


def interpolation_bounds(acceleration: Array, jerk: Array, cycle_s: float) -> Array:
    """Return the bounds of interpolation of axes with these limits, shape (2, K) [per s², per s³]."""
    limited = jerk * cycle_s < 2.0 * acceleration
    return np.stack(
        [np.where(limited, math.inf, acceleration), np.where(limited, VERTEX_JERK * jerk, math.inf)]
    )


@compiled
def _is_steep(displacement: float, v0: float, v1: float, bound: float) -> bool:
    """Return whether the cubic would accelerate by more than ``bound`` [per interval²]."""
    excess = displacement - 0.5 * (v0 + v1)
    return bool(6.0 * abs(excess) + abs(v1 - v0) > bound * (1.0 + 1e-9))


@compiled
def _special(
    displacement: float, v0: float, v1: float, share: float, bound: float, sharp: float
) -> tuple[float, float]:
    """Return displacement and velocity, per interval, where the cubic may not be used."""
    steep = _is_steep(displacement, v0, v1, bound)
    if _goes_one_way(displacement, v0, v1, bound, sharp, steep):
        power = _CONSTANT_JERK if math.isinf(bound) else _CONSTANT_ACCELERATION
        return _one_way(displacement, v0, v1, share, power)
    if steep:
        return _least_acceleration(displacement, v0, v1, share)
    return _cubic(displacement, v0, v1, share)


@compiled
def _goes_one_way(displacement: float, v0: float, v1: float, bound: float, sharp: float, steep: bool) -> bool:
    """Return whether a step is so near to one of the rows that the cubic would overshoot.

    With the change of speed w and e = d - (v0 + v1)/2 a step of w is at 1/2 - e/w of the interval, the cubic
    accelerates by w ± 6e, and the motion of least acceleration by 2|e| + √(4e² + w²).
    """
    excess, change = abs(displacement - 0.5 * (v0 + v1)), abs(v1 - v0)
    resting = (v0 == 0.0) != (v1 == 0.0)
    least = 2.0 * excess + math.sqrt(4.0 * excess * excess + change * change)
    sudden = resting or least > VERTEX_ACCELERATION * bound
    if change == 0.0:
        return False
    if 6.0 * excess <= change:
        return steep and sudden
    if sudden or 12.0 * excess > sharp:
        return True
    if math.isinf(bound) or 2.0 * excess >= change:
        return False
    # a constant acceleration that begins or ends between the rows
    return change * change / (change - 2.0 * excess) <= ONE_ACCELERATION * bound


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
def _one_way(displacement: float, v0: float, v1: float, share: float, power: int) -> tuple[float, float]:
    """Return displacement and velocity of a motion whose speed changes monotonically, per interval.

    It changes next to the row that is nearer to the step, within ``power`` times the step's distance from it.
    Displacement that no step between the rows explains is added by a cubic.
    """
    change = v1 - v0
    excess = displacement - 0.5 * (v0 + v1)
    place = min(max(0.5 - excess / change, 0.0), 1.0)
    rest = excess - (0.5 - place) * change
    moved, speed = rest * share * share * (3.0 - 2.0 * share), 6.0 * rest * share * (1.0 - share)
    if place < 0.5:
        left = max(0.0, 1.0 - share / (power * place + 1e-300))
        # with a step at ``place`` the displacement is v0 place + v1 (1 - place)
        moved += share * v1 - place * change * (1.0 - left**power)
        return moved, speed + v1 - change * left ** (power - 1)
    left = max(0.0, 1.0 - (1.0 - share) / (power * (1.0 - place) + 1e-300))
    moved += share * v0 + (1.0 - place) * change * left**power
    return moved, speed + v0 + change * left ** (power - 1)


@compiled
def positions_between(
    start: Array,
    end: Array,
    start_velocity: Array,
    end_velocity: Array,
    share: float,
    seconds: float,
    bounds: Array,
    position: Array,
) -> None:
    """Write positions at ``share`` of the interval between two rows.

    Args:
        start, end: positions, shape (K,) [m or rad]. start_velocity, end_velocity: there [per s].
        share: between 0 and 1. seconds: between the rows [s].
        bounds: see `STEEP` and `SHARP`, shape (2, K) [per s², per s³].
        position: written, shape (K,).
    """
    left = 1.0 - share
    rise, first = share * share * (3.0 - 2.0 * share), share * left * left * seconds
    last = -share * share * left * seconds
    square, cube = seconds * seconds * (1.0 + 1e-9), seconds**3 / 12.0
    special = 0
    # two simple loops over all columns, which are vectorized; columns that need more are rare
    for k in range(len(position)):
        displacement = end[k] - start[k]
        v0, v1 = start_velocity[k], end_velocity[k]
        position[k] = start[k] + (rise * displacement + first * v0 + last * v1)
        excess = displacement - 0.5 * seconds * (v0 + v1)
        change = seconds * abs(v1 - v0)
        steep = 6.0 * abs(excess) + change > bounds[STEEP, k] * square
        sharp = (abs(excess) > bounds[SHARP, k] * cube) | (bounds[STEEP, k] < math.inf)
        swings = sharp & (6.0 * abs(excess) > change)
        special |= steep | swings | ((v0 == 0.0) != (v1 == 0.0))
    if special:
        for k in range(len(position)):
            displacement = end[k] - start[k]
            v0, v1 = start_velocity[k] * seconds, end_velocity[k] * seconds
            steepest, sharpest = bounds[STEEP, k] * seconds**2, bounds[SHARP, k] * seconds**3
            moved, _ = _special(displacement, v0, v1, share, steepest, sharpest)
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
    bounds: Array,
    driven: NDArray[np.bool_],
    position: Array,
    velocity: Array,
) -> None:
    """Write setpoints and velocities of the driven columns between two rows of a ring.

    Args:
        rows, velocities: of the ring, shape (n, K) [m or rad, per s]. first, second: indices of the two rows.
        share, seconds, bounds: as in `positions_between`. rate: multiplies velocities [1].
        driven: shape (K,). position, velocity: written where driven, shape (K,).
    """
    for k in range(len(position)):
        if not driven[k]:
            continue
        displacement = rows[second, k] - rows[first, k]
        v0, v1 = velocities[first, k] * seconds, velocities[second, k] * seconds
        steepest, sharpest = bounds[STEEP, k] * seconds**2, bounds[SHARP, k] * seconds**3
        moved, speed = _special(displacement, v0, v1, share, steepest, sharpest)
        position[k] = rows[first, k] + moved
        velocity[k] = speed / seconds * rate
