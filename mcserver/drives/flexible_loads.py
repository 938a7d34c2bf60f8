"""Loads that hang on their motors by a spring: what makes an axis ring after a move.

With e = load - motor, ë + 2ζωė + ω²e = -ẍ, where x is the motor's position. A motor's velocity is taken as
constant within a cycle, so ė steps where that changes, and between two steps the solution is exact. The load
does not push its motor back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mcserver.drives.bus import Array
from mcserver.machine.axis import Axis
from mcserver.units import TURN


class FlexibleLoads:
    """The loads of n simulated axes, at which their encoders read.

    Attributes:
        present: some axis has one. swing: load minus motor, row 0 [m or rad] and its rate, row 1.
    """

    def __init__(self, axes: Sequence[Axis], cycle_s: float) -> None:
        self._cycle = cycle_s
        self.swing: Array = np.zeros((2, len(axes)))
        # what a cycle makes of swing and rate, rigid axes of nothing
        self._step: Array = np.zeros((2, 2, len(axes)))
        for column, axis in enumerate(axes):
            if axis.drive.flexible_hz > 0.0:
                self._step[:, :, column] = _decay(
                    axis.drive.flexible_hz, axis.drive.flexible_damping, cycle_s
                )
        self.present = bool(self._step.any())
        self._position: Array | None = None
        self._velocity: Array = np.zeros(len(axes))

    def follow(self, position: Array) -> None:
        """Let a cycle pass in which the motors come to positions, shape (n,) [m or rad]."""
        before = position if self._position is None else self._position
        velocity = (position - before) / self._cycle
        self.swing[1] -= velocity - self._velocity
        self._position, self._velocity = position.copy(), velocity
        self.swing = (self._step * self.swing[None]).sum(axis=1)


def _decay(frequency_hz: float, damping: float, seconds: float) -> Array:
    """Return what a time makes of a swing and its rate, shape (2, 2)."""
    omega = frequency_hz * TURN
    damped = omega * math.sqrt(1.0 - damping**2)
    decay, cos, sin = (
        math.exp(-damping * omega * seconds),
        math.cos(damped * seconds),
        math.sin(damped * seconds),
    )
    share = damping * omega / damped
    return decay * np.array(
        [[cos + share * sin, sin / damped], [-(omega**2) / damped * sin, cos - share * sin]]
    )
