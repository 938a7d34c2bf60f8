"""Rows that playback needs ahead: it can always stop before the last row it has, unless that is at rest."""

from __future__ import annotations

import math

import numpy as np

from mcserver.executor.entries import Array
from mcserver.machine.machine_file import Machine

# Stops that rows handed over ahead leave room for: one takes half of its time in rows; it has room for one of
# the rows' own, and for one of playback that leaves some of the limits to the rows.
STOPS_AHEAD = 1.4
SPARE_ROWS = 16


def torque_axes(machine: Machine) -> int:
    """Return how many axes have a greatest torque."""
    return sum(axis.max_torque != math.inf for axis in machine.axes)


def longest_stop(machine: Machine) -> float:
    """Return the longest time that an axis takes to stop from its top speed within its limits [cycles]."""
    return float(StopTimes(machine).of(np.array([[axis.max_velocity for axis in machine.axes]]))[0])


class StopTimes:
    """How long stops take from the speeds of rows."""

    def __init__(self, machine: Machine) -> None:
        acceleration = np.array([axis.max_acceleration for axis in machine.axes])
        jerk = np.array([axis.max_jerk for axis in machine.axes])
        self._acceleration = acceleration * machine.cycle_s
        self._rounding = np.where(np.isfinite(jerk), acceleration / jerk, 0.0) / machine.cycle_s

    def of(self, velocity: Array) -> Array:
        """Return the longest time that an axis takes to stop within its limits, shape (n,) [cycles].

        Args:
            velocity: shape (n, K) [m/s or rad/s]. An axis that stands takes none.
        """
        speed = np.abs(velocity)
        times: Array = np.where(speed > 0.0, speed / self._acceleration + self._rounding, 0.0).max(axis=1)
        return times


def stopping_rows(stop: float) -> int:
    """Return the rows ahead with which playback at 100 % never slows down for a stop that takes so long.

    A planner that hands over fewer rows of a motion under way is played more slowly; one that hands over a
    motion's whole stop is not.

    Args:
        stop: of the rows that are ahead [cycles].
    """
    return math.ceil(STOPS_AHEAD * stop) + SPARE_ROWS
