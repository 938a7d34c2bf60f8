"""Axes whose drives generate the profile (profile position mode): they get goals, not paths.

The setpoints of such an axis are the profile that its limits allow, which `simulate` shows. The drive's own
profile is similar, not equal: so following errors are checked only once the axis has arrived, and a motion
ends only when the drive's has ended.
"""

from __future__ import annotations

import math

from mcserver.executor.axes import AxisBank
from mcserver.executor.independent import IndependentMotions
from mcserver.machine.machine_file import Machine


class ProfiledAxes:
    """Commands to these drives, and supervision of them.

    Attributes:
        mask: their columns. unsettled: columns that the drive moves or has halted, whose following error
            means nothing. late: columns whose motion exceeds its setpoints by the exact-stop time-out in this
            cycle.
    """

    def __init__(self, machine: Machine, bank: AxisBank, motions: IndependentMotions) -> None:
        self._bank = bank
        self._motions = motions
        self._columns = tuple(column for column, axis in enumerate(machine.axes) if axis.profiled)
        self._tolerance = [axis.in_position for axis in machine.axes]
        self._patience = max(1, round(machine.exact_stop_timeout / machine.cycle_s))
        self._waited = dict.fromkeys(self._columns, 0)
        self.mask = sum(1 << column for column in self._columns)
        self.unsettled = self.mask
        self.late: list[int] = []

    def before_exchange(self) -> None:
        """Set the goals: kept after a motion that has reached its target, removed after any other."""
        bank, goals = self._bank, self._motions.goals
        for column in self._columns:
            bit = 1 << column
            if not bank.energized & bank.positioned & bit:
                # the goal before it was de-energized no longer applies
                goals.pop(column, None)
            goal, speed = goals.get(column, (math.nan, 0.0))
            if goal != bank.goal[column]:
                self.unsettled |= bit
                self._waited[column] = 0
            bank.goal[column], bank.goal_speed[column] = goal, speed

    def shift(self, column: int, distance: float) -> None:
        """Let the column's positions read ``distance`` more from now on."""
        goals = self._motions.goals
        if column in goals and self.mask >> column & 1:
            goal, speed = goals[column]
            goals[column] = goal + distance, speed
            self._bank.goal[column] += distance

    def after_exchange(self) -> None:
        """Find the axes that have arrived; a halted axis is where its drive has stopped it."""
        bank, row, motions = self._bank, self._bank.row, self._motions
        self.late.clear()
        pending = 0
        for column in self._columns:
            bit = 1 << column
            if not self.unsettled & bit & bank.energized & bank.positioned:
                continue
            if math.isnan(bank.goal[column]):
                if abs(row.actual_velocity[column]) > bank.standing_speed[column]:
                    pending |= bit
                if not motions.mask & bit:
                    row.ordered[column] = row.setpoint[column] = row.actual[column]
                continue
            ended = row.setpoint[column] == bank.goal[column]
            if ended and abs(row.setpoint[column] - row.actual[column]) <= self._tolerance[column]:
                self.unsettled &= ~bit
                continue
            pending |= bit
            self._waited[column] += ended
            if self._waited[column] == self._patience:
                self.late.append(column)
        motions.pending = pending
