"""Backlash and errors of position in the cycle: what a drive is told besides the setpoint.

A reversal of the setpoint moves the drive by the backlash, within a share of the axis's limits that programs
do not use. Errors of pitch, squareness and a mesh are functions of where axes are that know it. Where one of
these begins to count, or its place reads something else, the correction goes there by the same share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Array
from mcserver.executor.error_tables import ErrorTable, MeshErrors, PitchErrors, SquareErrors
from mcserver.executor.shm.feedback import FeedbackRow
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine

# A setpoint that comes back by less has not turned, it is rounded [m or rad].
TURNED = 1e-8
# Corrections are less than this [m or rad].
FARTHEST = 1.0


class Compensator:
    """Corrections of all axes, of most of them 0.

    Attributes:
        correction, rate: shape (K,), what drives get beside position and velocity [m or rad, per second].
        unsettled: shape (K,), whether backlash is being taken up.
        homed: shape (K,), which axes know where they are; set anew in each cycle.
        tables: errors of axes by where they are.
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
        self.homed: NDArray[np.bool_] = np.ones(count, np.bool_)
        self.tables: list[CountedErrors] = []
        columns, half, limits = [], [], []
        for column, axis in enumerate(machine.axes):
            found = axis.compensation
            if found is None:
                continue
            columns.append(column)
            half.append(0.5 * found.backlash)
            limits.append(_limits_of(axis, found.share))
            self.tables += [CountedErrors(each, len(columns) - 1) for each in _tables_of(machine, column)]
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
        states, targets, setpoint = self._states, self._targets, row.setpoint[columns]
        on, held = held, held[columns]
        way = setpoint - self._furthest
        turned = held & (self._direction * way <= 0.0) & (np.abs(way) > TURNED)
        np.copyto(self._direction, np.sign(way), where=turned)
        np.copyto(self._furthest, setpoint, where=turned | ~held | (self._direction * way > 0.0))
        # what is taken up of an axis that is off stays as it is
        targets[:, 0] = np.where(held, self._direction * self._half, states[:, 0])
        states[~held, 1:] = 0.0
        errors, rates = np.zeros(len(columns)), np.zeros(len(columns))
        for table in self.tables:
            jump = table.look(row, on, self.homed)
            errors[table.place] += table.error
            rates[table.place] += table.rate
            states[table.place, 0] += jump
        self._follow(states, targets, self._limits, 1.0, self._cycle, False)
        self.correction[columns] = states[:, 0] - errors
        self.rate[columns] = states[:, 1] - rates
        self.unsettled[columns] = (states[:, 0] != targets[:, 0]) | (states[:, 1:] != 0.0).any(axis=1)

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        self._furthest[self._columns == column] += distance
        for table in self.tables:
            table.moved |= column in table.errors.sources

    def change(self, table: CountedErrors, axis: Axis, share: float) -> None:
        """Note that a table counts otherwise from now on, and which share of its axis's limits goes there."""
        table.moved = True
        self._limits[table.place] = _limits_of(axis, share)
        # until the next cycle has looked
        self.unsettled[table.errors.column] = True


def _limits_of(axis: Axis, share: float) -> list[float]:
    """Return what corrections that jump or take up backlash keep to, by a share of the limits in the file."""
    found = axis.compensation
    assert found is not None
    # of the limits in the file programs have the rest
    share /= 1.0 - found.reserve
    # of a table alone nothing may be left: it is small, and jumps at the reference alone
    share = share if share > 0.0 else 1.0
    most = [share * each for each in (axis.max_velocity, axis.max_acceleration, axis.max_jerk)]
    return [*most, -FARTHEST, FARTHEST]


class CountedErrors:
    """An error of an axis, as it counts now.

    Args:
        place: of its axis among the compensated ones.

    Attributes:
        error, rate: in this cycle. on: it counts. needs: columns that have to be homed for it.
        moved: it, or its places, read something else than in the cycle before.
    """

    def __init__(self, errors: ErrorTable, place: int) -> None:
        self.errors, self.place, self.needs = errors, place, errors.sources
        self.error = self.rate = 0.0
        self.on = self.moved = True
        self._known = False

    def look(self, row: FeedbackRow, held: NDArray[np.bool_], homed: NDArray[np.bool_]) -> float:
        """Take the error of this cycle; return by how much it has jumped where its axis is held."""
        before, sources = self.error, self.errors.sources
        follows = bool(held[self.errors.column])
        if follows and not held[sources].all():
            # what is off is pushed about: the error stays until its place is held again
            self.rate, self.moved = 0.0, True
            return 0.0
        known = self.on and bool(homed[self.needs].all())
        self.error, self.rate = self.errors.at(row.setpoint, row.velocity) if known else (0.0, 0.0)
        jumped, self.moved = self.moved or known != self._known, False
        self._known = known
        return self.error - before if follows and jumped else 0.0


def _tables_of(machine: Machine, column: int) -> list[ErrorTable]:
    """Return the errors of a column's axis."""
    found = machine.axes[column].compensation
    tables: list[ErrorTable] = []
    if found is None:
        return tables
    if len(found.pitch_errors) > 0:
        # a single point is an error everywhere
        points = found.pitch_errors if len(found.pitch_errors) > 1 else found.pitch_errors * 2
        places, errors = np.array(points).T
        places = places + np.array([0.0, 1.0]) if len(found.pitch_errors) == 1 else places
        tables.append(PitchErrors(column, places, errors))
    if found.square_errors:
        slopes = {machine.column_of(axis): slope for axis, slope in found.square_errors}
        tables.append(SquareErrors(column, slopes))
    if found.mesh is not None:
        sources = [machine.column_of(axis) for axis in found.mesh.axes]
        tables.append(MeshErrors(column, sources, found.mesh))
    return tables
