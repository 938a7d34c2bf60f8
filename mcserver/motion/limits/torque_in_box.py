"""Axis limits that keep the joints' torques for any motion between bounds, as streamed targets need.

Streamed targets have no path along which torques could be planned. With |q̈| ≤ A and |q̇| ≤ V of each axis,
|τ - g(q)| ≤ Σ |M(q)| A + Σ |c(q)| V V (M: inertias, c: Coriolis and centrifugal terms, both columns of RNEA).
With accelerations s·A and velocities √s·V the right side is scaled by s, so |τ| ≤ τmax requires
s ≤ (τmax - |g|) / (Σ |M| A + Σ |c| V V). The minimum over a box is searched at random positions, and from the
worst of these along each axis in turn.
"""

from __future__ import annotations

import math
from itertools import combinations

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.machine.axis import Axis
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.torque_limits import TorqueLimits

# Random positions that are evaluated.
PLACES = 300
# Number of the worst of them from which the search goes on.
WORST = 3
# Positions evaluated along one axis, and rounds over all axes.
ALONG, ROUNDS = 9, 2
# Margin for positions between those that were evaluated.
FOUND_SHARE = 0.97


class TorqueBox:
    """Bounds of positions, velocities and accelerations within which a tool's torques are evaluated.

    Args:
        low, high: of all columns of the machine, shape (K,) [m or rad]; equal where an axis stands still. An
            axis without travel limits is taken over one turn.
        velocity, acceleration: limits of all columns, shape (K,); 0 where an axis stands still.
    """

    def __init__(
        self, limits: TorqueLimits, low: Array, high: Array, velocity: Array, acceleration: Array
    ) -> None:
        columns = limits.columns
        self._limits = limits
        self._low = np.where(np.isfinite(low[columns]), low[columns], -math.pi)
        self._high = np.where(np.isfinite(high[columns]), high[columns], self._low + 2.0 * math.pi)
        self._velocity, self._acceleration = velocity[columns], acceleration[columns]

    @property
    def moves(self) -> bool:
        """Whether any of the joints may move."""
        return bool((self._acceleration > 0.0).any())

    def share(self) -> tuple[float, int]:
        """Return the share s that keeps all torques, and the machine's column of the joint that bounds it.

        s, from 0 (holding still exceeds a limit somewhere) to 1, scales accelerations; √s scales velocities.
        """
        numbers = np.random.default_rng(0)
        places = self._low + (self._high - self._low) * numbers.random((PLACES, len(self._low)))
        shares, joints = self._shares(places)
        for start in places[np.argsort(shares)[:WORST]]:
            place = start
            for joint in [*range(len(place))] * ROUNDS:
                if self._low[joint] == self._high[joint]:
                    continue
                along = np.tile(place, (ALONG, 1))
                along[:, joint] = np.linspace(self._low[joint], self._high[joint], ALONG)
                found, by = self._shares(along)
                place = along[found.argmin()]
                shares, joints = np.append(shares, found), np.append(joints, by)
        worst = int(shares.argmin())
        least = float(np.clip(FOUND_SHARE * shares[worst], 0.0, 1.0))
        return least, self._limits.column_of(int(joints[worst]))

    def _shares(self, q: Array) -> tuple[Array, NDArray[np.intp]]:
        """Return s at each of n positions, and the index of the limit that bounds it, shape (n,) each."""
        still = np.zeros_like(q)
        rest = self._torques(q, still, still)
        taken = np.zeros_like(rest)
        moving = np.flatnonzero(self._acceleration > 0.0).tolist()
        alone = {}
        for joint in moving:
            taken += np.abs(self._torques(q, still, self._only(q, self._acceleration, joint)) - rest)
            alone[joint] = self._torques(q, self._only(q, self._velocity, joint), still) - rest
            taken += np.abs(alone[joint])
        for first, second in combinations(moving, 2):
            both = self._only(q, self._velocity, first) + self._only(q, self._velocity, second)
            mixed = self._torques(q, both, still) - rest
            taken += np.abs(mixed - alone[first] - alone[second])
        left = np.maximum(self._limits.limits - np.abs(rest), 0.0)
        shares = left / np.maximum(taken, np.finfo(float).tiny)
        by = shares.argmin(axis=1)
        return shares[np.arange(len(q)), by], by

    def _torques(self, q: Array, dq: Array, d2q: Array) -> Array:
        found: Array = self._limits.dynamics.torques(q, dq, d2q)[:, self._limits.limited]
        return found

    def _only(self, q: Array, of_joints: Array, joint: int) -> Array:
        found = np.zeros_like(q)
        found[:, joint] = of_joints[joint]
        return found


def followed_axis(axis: Axis, share: float) -> Axis:
    """Return an axis with its acceleration scaled by ``share`` and its velocity by the root of it."""
    if share == 1.0:
        return axis
    return msgspec.structs.replace(
        axis,
        max_velocity=math.sqrt(share) * axis.max_velocity,
        max_acceleration=share * axis.max_acceleration,
    )
