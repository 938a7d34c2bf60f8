"""Number of rows that playback needs ahead in order to be able to stop before the last one."""

from __future__ import annotations

import math

import numpy as np

from mcserver.executor.entries import Array
from mcserver.machine.machine_file import Machine

# Rows ahead, in durations of a stop. A stop covers half of its duration in rows: this leaves room for one of
# the rows themselves, and for one of playback that leaves a part of the limits to the rows.
STOPS_AHEAD = 1.4
SPARE_ROWS = 16


def torque_axes(machine: Machine) -> int:
    """Return the number of axes with a torque limit."""
    return sum(axis.max_torque != math.inf for axis in machine.axes)


def longest_stop(machine: Machine) -> float:
    """Return the longest time that an axis takes to stop from its top speed within its limits [cycles]."""
    return float(StopTimes(machine).of(np.array([[axis.max_velocity for axis in machine.axes]]))[0])


class StopTimes:
    """Computes the duration of stops from the speeds of rows."""

    def __init__(self, machine: Machine) -> None:
        acceleration = np.array([axis.max_acceleration for axis in machine.axes])
        jerk = np.array([axis.max_jerk for axis in machine.axes])
        self._acceleration = acceleration * machine.cycle_s
        self._rounding = np.where(np.isfinite(jerk), acceleration / jerk, 0.0) / machine.cycle_s

    def of(self, velocity: Array) -> Array:
        """Return the longest time that an axis takes to stop within its limits, shape (n,) [cycles].

        Args:
            velocity: shape (n, K) [m/s or rad/s]. An axis at rest takes no time.
        """
        speed = np.abs(velocity)
        times: Array = np.where(speed > 0.0, speed / self._acceleration + self._rounding, 0.0).max(axis=1)
        return times


def stopping_rows(stop: float) -> int:
    """Return the number of rows ahead with which playback at 100 % does not slow down to be able to stop.

    With fewer rows of a motion ahead, playback is slower, unless these include the motion's own stop.

    Args:
        stop: longest duration of a stop from the rows ahead [cycles].
    """
    return math.ceil(STOPS_AHEAD * stop) + SPARE_ROWS
