"""Limits of the joints' torques as limits along a path.

Along σ, τ = a·v̇ + b·v² + g (`mckinematics.dynamics`), and |τ| ≤ τmax is required. Gravity leaves τmax - |g|,
and |a|·|v̇| + |b|·v² ≤ τmax - |g| suffices for both signs of v̇. An axis's acceleration limit has the same
form, |q'|·|v̇| + |q''|·v² ≤ amax: so a joint's torque, divided by τmax - |g|, is one more column of the
samples whose acceleration is limited to 1, and kernels need not know of torques.

A constant playback rate r from 0 to 1 scales v̇ and v² by r² and leaves g: with |g| ≤ τmax a slower motion
keeps the limits too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from mckinematics.dynamics import JointDynamics
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.curves import Array

# A path is refused where holding still takes more than this share of a torque limit.
HOLDING_SHARE = 0.99
# Least share left to the motion, also where a blend leads to where holding still takes more.
LEAST_LEFT = 1.0 - HOLDING_SHARE
# Greatest joint travel between samples [rad or m].
APART = 0.04
# Most samples on one segment.
MOST_SAMPLES = 400


@dataclass(frozen=True)
class TorqueLimits:
    """The torque limits of a machine.

    Attributes:
        dynamics: torques of the joints that tools' axes move. columns: the machine's columns of these axes,
            shape (N,). limited: indices of those with a limit, shape (J,). limits: theirs, shape (J,)
            [N·m, N].
        share: of what gravity leaves, that the motion may use.
    """

    dynamics: JointDynamics
    columns: NDArray[np.intp]
    limited: NDArray[np.intp]
    limits: Array
    share: float = 1.0

    @classmethod
    def of(cls, machine: Machine, dynamics: JointDynamics | None) -> TorqueLimits | None:
        """Return the limits of a machine, None without any."""
        if dynamics is None or not dynamics.limited:
            return None
        (limited,) = np.nonzero(np.isfinite(dynamics.limits))
        columns = np.array([machine.column_of(axis) for axis in dynamics.axes], dtype=np.intp)
        return cls(dynamics, columns, limited, dynamics.limits[limited])

    def beside(self, rows: Array) -> Array:
        """Append the limits of the torques' columns to those of axes, shape (3, K) to (3, K + J)."""
        own = np.full((3, len(self.limits)), math.inf)
        own[1] = 1.0
        return np.hstack((rows, own))

    def column_of(self, index: int) -> int:
        """Return the machine's column of one of the J limits."""
        return int(self.columns[self.limited[index]])

    def on_path(self, q: Array, dq: Array, d2q: Array, carried: tuple[int, ...]) -> tuple[Array, Array]:
        """Return |a| and |b| divided by what gravity leaves of the limits, shape (n, J) each.

        Args:
            q, dq, d2q: of all columns of the machine by σ, shape (n, K).
        """
        where = self.columns
        found = self.dynamics.along_path(q[:, where], dq[:, where], d2q[:, where], carried)
        rest = np.abs(found.rest[:, self.limited])
        left = self.share * np.maximum(self.limits - rest, LEAST_LEFT * self.limits)
        return np.abs(found.inertial[:, self.limited]) / left, np.abs(found.square[:, self.limited]) / left

    def of_rows(self, q: Array, dq: Array, d2q: Array, change: Array, carried: tuple[int, ...]) -> Array:
        """Return torques of rows in shares of the limits, shape (n, 3, J), numbered as in `row_torques`.

        Args:
            q, dq, d2q: positions, velocities and accelerations of all columns by time, shape (n, K).
            change: accelerations that a change of the playback rate by 1 per cycle adds, shape (n, K).
        """
        where, torques = self.columns, self.dynamics.torques
        place, still = q[:, where], np.zeros((len(q), len(where)))
        rest = torques(place, still, still, carried)
        motion = torques(place, dq[:, where], d2q[:, where], carried) - rest
        added = torques(place, still, change[:, where], carried) - rest
        stacked: Array = np.stack([rest, motion, added], axis=1)
        return stacked[:, :, self.limited] / self.limits

    def load(self, q: Array, dq: Array, d2q: Array, carried: tuple[int, ...]) -> float:
        """Return the greatest share of a limit that a motion takes; derivatives by time, shape (n, K)."""
        where = self.columns
        torques = self.dynamics.torques(q[:, where], dq[:, where], d2q[:, where], carried)
        return float((np.abs(torques[:, self.limited]) / self.limits).max(initial=0.0))

    def count(self, positions: Array) -> int:
        """Return the number of samples that a path needs, given positions (n, K) on it."""
        travel = np.abs(np.diff(positions[:, self.columns], axis=0)).sum(axis=0).max(initial=0.0)
        return min(2 + math.ceil(float(travel) / APART), MOST_SAMPLES)
