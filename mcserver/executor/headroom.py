"""Headroom of setpoint rows: the greatest rate at which each may be played within the axes' limits.

With playback rate r (in cycles of the program a cycle) and the rows' differences dq, d2q and d3q, an axis
moves at r dq, accelerates at r² d2q and jerks at r³ d3q while r is steady. The rates are found by the writer,
a batch at a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.row_torques import steady_rates

Array = NDArray[np.float64]

# The greatest playback rate: a feed override of 2 on rows of twice the pace.
RATE_MAX = 4.0
# Rows that are handed over ahead, as a multiple of what the longest stop passes: one stop of the rows' own,
# and one of playback that leaves some of the limits to the rows.
STOPS_AHEAD = 3.2


@dataclass(frozen=True)
class AxisLimits:
    """Limits of all axes, shape (K,) [SI]; infinite where an axis has none.

    Attributes:
        rate: greatest playback rate of rows that come without torques: where these are limited, they are
            known to be kept at 100 % and less.
    """

    velocity: Array
    acceleration: Array
    jerk: Array
    cycle_s: float
    rate: float = RATE_MAX

    @classmethod
    def of(cls, machine: Machine) -> AxisLimits:
        return cls(
            np.array([axis.max_velocity for axis in machine.axes]),
            np.array([axis.max_acceleration for axis in machine.axes]),
            np.array([axis.max_jerk for axis in machine.axes]),
            machine.cycle_s,
            1.0 if any(axis.max_torque != math.inf for axis in machine.axes) else RATE_MAX,
        )


class HeadroomWriter:
    """Headroom of rows as they are put, batch by batch."""

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits
        self._bits = np.arange(len(limits.velocity), dtype=np.uint64)
        self.restart()

    def restart(self) -> None:
        """Forget the rows before: what comes next begins a new program."""
        count = len(self._limits.velocity)
        self._u = -(1 << 60)
        self._mask = 0
        self._velocity = np.zeros(count)
        self._acceleration = np.zeros(count)

    def behind(self, u: int, mask: int, earlier: Array, velocity: Array) -> HeadroomWriter:
        """Return a writer for rows that follow the one at ``u``.

        Args:
            mask: of the columns that both it and the row before drive. earlier, velocity: of that row and
                its own, shape (K,).
        """
        writer = HeadroomWriter(self._limits)
        driven = ((np.uint64(mask) >> self._bits) & np.uint64(1)).astype(np.bool_)
        writer._u, writer._mask, writer._velocity = u, mask, velocity.copy()
        writer._acceleration = np.where(driven, velocity - earlier, 0.0) / self._limits.cycle_s
        return writer

    def of(
        self, first_u: int, velocity: Array, masks: NDArray[np.uint64], torque: Array | None = None
    ) -> Array:
        """Return the greatest rates of rows that follow those of the calls before, 1 to the limits', shape
        (n,).

        The rate of a row is about the motion from the row before to it.

        Args:
            torque: of the rows, shape (n, 3, J), see `row_torques`; None: not known.
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
        magnitude = np.abs(acceleration) + 1e-30
        cap = np.minimum(
            np.minimum(limits.velocity / speed, np.sqrt(limits.acceleration / magnitude)),
            np.cbrt(limits.jerk / (jerk + 1e-30)),
        ).min(axis=1)
        if torque is not None:
            cap = np.minimum(cap, steady_rates(torque))
        rates: Array = np.clip(cap, 1.0, limits.rate if torque is None else RATE_MAX)
        if not joined:
            # no motion leads to this row
            rates[0] = RATE_MAX
        self._u = first_u + count - 1
        self._mask = int(masks[-1])
        self._velocity = velocity[-1].copy()
        self._acceleration = acceleration[-1].copy()
        return rates


def torque_axes(machine: Machine) -> int:
    """Return how many axes have a greatest torque."""
    return sum(axis.max_torque != math.inf for axis in machine.axes)


def longest_stop(machine: Machine) -> float:
    """Return the longest time that an axis takes to stop from its top speed within its limits [s]."""
    return max(
        axis.max_velocity / axis.max_acceleration
        + (axis.max_acceleration / axis.max_jerk if math.isfinite(axis.max_jerk) else 0.0)
        for axis in machine.axes
    )


def stopping_rows(machine: Machine, by_torque: int = 0) -> int:
    """Rows ahead with which playback at 100 % never slows down: the longest stop of any axis.

    Playback can always stop before the last row it has, unless that row is at rest. A planner that hands over
    fewer rows of a motion under way is played more slowly; one that hands over a motion's whole stop is not.

    Args:
        by_torque: the longest stop that torques ask for [cycles].
    """
    return math.ceil(0.5 * STOPS_AHEAD * max(longest_stop(machine) / machine.cycle_s, by_torque)) + 16
