"""Backlash and errors of pitch in the cycle: what a drive is told besides the setpoint.

A reversal of the setpoint moves the drive by the backlash, within a share of the axis's limits that programs
do not use. Errors of pitch follow a table, with quintic steps between its points: their third derivative is
bounded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Array
from mcserver.executor.shm.feedback import FeedbackRow
from mcserver.machine.machine_file import Machine

# A setpoint that comes back by less has not turned, it is rounded [m or rad].
TURNED = 1e-8


class Compensator:
    """Corrections of all axes, of most of them 0.

    Attributes:
        correction, rate: shape (K,), what drives get beside position and velocity [m or rad, per second].
        unsettled: shape (K,), whether backlash is being taken up.
    """

    def __init__(self, machine: Machine, row: FeedbackRow) -> None:
        # machines without corrections start without compiled code
        from mcserver.motion.kernels.target_tracking import follow_targets

        self._follow = follow_targets
        self._row = row
        count = len(machine.axes)
        self.correction: Array = np.zeros(count)
        self.rate: Array = np.zeros(count)
        self.unsettled: NDArray[np.bool_] = np.zeros(count, np.bool_)
        self._cycle = machine.cycle_s
        self._tables: list[tuple[int, Array, Array]] = []
        columns, half, limits = [], [], []
        for column, axis in enumerate(machine.axes):
            found = axis.compensation
            if found is None:
                continue
            columns.append(column)
            half.append(0.5 * found.backlash)
            # of the limits in the file, of which programs have the rest
            share = found.share / (1.0 - found.reserve) if found.backlash > 0.0 else 1.0
            most = [share * each for each in (axis.max_velocity, axis.max_acceleration, axis.max_jerk)]
            limits.append([*most, -found.backlash, found.backlash])
            if found.pitch_errors:
                places, errors = np.array(found.pitch_errors).T
                self._tables.append((column, places, errors))
        # what follows has one entry for each compensated axis
        self._columns = np.array(columns, np.intp)
        self._half, self._limits = np.array(half), np.array(limits)
        # position, velocity and acceleration, as `follow_targets` has them
        self._states = np.zeros((len(columns), 3))
        self._targets = np.zeros((len(columns), 3))
        # of the way since the last reversal: its direction, 0 before the first, and how far it has come
        self._direction = np.zeros(len(columns))
        self._furthest = row.setpoint[self._columns]

    def compensate(self, held: NDArray[np.bool_]) -> None:
        """Set the corrections of this cycle; ``held``: which axes follow their setpoints, shape (K,)."""
        row, columns = self._row, self._columns
        states, targets, setpoint, held = self._states, self._targets, row.setpoint[columns], held[columns]
        way = setpoint - self._furthest
        turned = held & (self._direction * way <= 0.0) & (np.abs(way) > TURNED)
        np.copyto(self._direction, np.sign(way), where=turned)
        np.copyto(self._furthest, setpoint, where=turned | ~held | (self._direction * way > 0.0))
        # what is taken up of an axis that is off stays as it is
        targets[:, 0] = np.where(held, self._direction * self._half, states[:, 0])
        states[~held, 1:] = 0.0
        self._follow(states, targets, self._limits, 1.0, self._cycle, False)
        self.correction[columns], self.rate[columns] = states[:, 0], states[:, 1]
        self.unsettled[columns] = (states[:, 0] != targets[:, 0]) | (states[:, 1:] != 0.0).any(axis=1)
        for column, places, errors in self._tables:
            error, slope = _step(float(row.setpoint[column]), places, errors)
            self.correction[column] -= error
            self.rate[column] -= slope * float(row.velocity[column])

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        self._furthest[self._columns == column] += distance


def _step(place: float, places: Array, errors: Array) -> tuple[float, float]:
    """Return a table's value and slope at a place; beyond its ends it stays what it is there."""
    after = int(np.searchsorted(places, place, side="right"))
    if after == 0 or after == len(places):
        return float(errors[max(after - 1, 0)]), 0.0
    width = float(places[after] - places[after - 1])
    height = float(errors[after] - errors[after - 1])
    u = (place - float(places[after - 1])) / width
    value = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    return float(errors[after - 1]) + height * value, height / width * 30.0 * u**2 * (1.0 - u) ** 2
