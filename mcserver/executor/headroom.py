"""What each setpoint row leaves of the axes' limits: how fast it may be played, how fast playback may slow
down.

With playback rate r (in cycles of the program a cycle), w = r² and row velocity q', row acceleration q'':
an axis moves at r·q' and accelerates at r²·q'' + r'·q', and dw/du = 2·r'. So a bound b on |r'| in each row
gives, by sums of 2·b·dt, how much w can fall between two rows. The sums are made by the writer, a batch at a
time; the executor then knows by one subtraction whether it can still stop before a row, or slow down to what
a row allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine

Array = NDArray[np.float64]

# The greatest feed override.
RATE_MAX = 2.0
# Share of an axis's acceleration that plans of slowing down count on; the rest is for rounding and smoothing.
PLANNED_SHARE = 0.9
# Largest change of the rate a second, where axes hardly move.
SLOPE_MAX = 500.0

# Columns of a row's headroom: running sums of what w can lose while r <= 1 and while r <= √½; the same at
# the row's own greatest rate; and that greatest rate's w plus the sum there (see `fastest`).
FULL, HALF, OWN, CAP = range(4)
WIDTH = 4


@dataclass(frozen=True)
class AxisLimits:
    """Limits of all axes, shape (K,) [SI]; infinite where there is none."""

    velocity: Array
    acceleration: Array
    jerk: Array
    cycle_s: float

    @classmethod
    def of(cls, machine: Machine) -> AxisLimits:
        return cls(
            np.array([axis.max_velocity for axis in machine.axes]),
            np.array([axis.max_acceleration for axis in machine.axes]),
            np.array([axis.max_jerk for axis in machine.axes]),
            machine.cycle_s,
        )


class HeadroomWriter:
    """Headroom of rows as they are put, batch by batch."""

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits
        self._bits = np.arange(len(limits.velocity), dtype=np.uint64)
        self.restart()

    def restart(self) -> None:
        """Forgets the rows before: what comes next begins a new program."""
        count = len(self._limits.velocity)
        self._sums = np.zeros(3)
        self._u = -(1 << 60)
        self._mask = 0
        self._velocity = np.zeros(count)
        self._acceleration = np.zeros(count)

    def of(self, first_u: int, velocity: Array, masks: NDArray[np.uint64]) -> Array:
        """Headroom of rows that follow those of the calls before; shape (n, `WIDTH`).

        What is stored with a row is about the motion from the row before to it.
        """
        limits = self._limits
        count = len(velocity)
        joined = first_u == self._u + 1
        before = masks[:1] if not joined else np.array([self._mask], np.uint64)
        driven = np.concatenate([before, masks[:-1]]) & masks
        if (driven == driven[0]).all():
            active = ((driven[:1, None] >> self._bits) & np.uint64(1)).astype(np.bool_)
        else:
            active = ((driven[:, None] >> self._bits) & np.uint64(1)).astype(np.bool_)
        rows = np.concatenate([(self._velocity if joined else velocity[0])[None, :], velocity])
        start, end = np.where(active, rows[:-1], 0.0), np.where(active, rows[1:], 0.0)
        acceleration = (end - start) / limits.cycle_s
        earlier = np.concatenate([self._acceleration[None, :], acceleration[:-1]])
        jerk = np.abs(acceleration - earlier) / limits.cycle_s
        speed = np.maximum(np.abs(start), np.abs(end)) + 1e-30
        braking = np.maximum(0.0, -acceleration * np.sign(start + end))
        magnitude = np.abs(acceleration) + 1e-30
        cap = np.minimum(
            np.minimum(limits.velocity / speed, np.sqrt(limits.acceleration / magnitude)),
            np.cbrt(limits.jerk / (jerk + 1e-30)),
        ).min(axis=1)
        cap_w = np.clip(cap, 1.0, RATE_MAX) ** 2
        planned = PLANNED_SHARE * limits.acceleration
        gains = np.empty((count, 3))
        for column, w in enumerate((np.array([1.0]), np.array([0.5]), cap_w)):
            slope = (np.maximum(planned - w[:, None] * braking, 0.0) / speed).min(axis=1)
            gains[:, column] = 2.0 * limits.cycle_s * np.minimum(slope, SLOPE_MAX)
        if not joined:
            # no motion leads to this row
            gains[0] = 2.0 * limits.cycle_s * SLOPE_MAX
            cap_w[0] = RATE_MAX**2
        sums = self._sums + np.cumsum(gains, axis=0)
        self._sums = sums[-1].copy()
        self._u = first_u + count - 1
        self._mask = int(masks[-1])
        self._velocity = velocity[-1].copy()
        self._acceleration = acceleration[-1].copy()
        return np.concatenate([sums, (cap_w + sums[:, OWN])[:, None]], axis=1)


def stopping_rows(machine: Machine) -> int:
    """Rows ahead with which playback at 100 % never slows down: the longest stop of any axis from its top
    speed.

    Playback can always stop before the last row it has, unless that row is at rest. A planner that hands over
    fewer rows of a motion under way is played more slowly; one that hands over a motion's whole stop is not.
    """
    longest = max(axis.max_velocity / axis.max_acceleration for axis in machine.axes)
    # a stop that rows make themselves, and before it room for one that playback makes
    return math.ceil((1.0 + 0.5 / PLANNED_SHARE) * longest / machine.cycle_s) + 16
