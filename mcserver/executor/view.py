"""Where an executor's programs and axes are, as its newest cycle shows them."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np

from mcserver.executor.shm.feedback import AxisCondition, FeedbackState
from mcserver.machine.machine_file import Machine

ENERGIZED = frozenset(
    {
        AxisCondition.HOLDING,
        AxisCondition.MOVING,
        AxisCondition.SPEED,
        AxisCondition.TORQUE,
        AxisCondition.STOPPING,
    }
)


class SlotView(msgspec.Struct, frozen=True):
    """One executor slot: where its program is on its time axis, how fast that passes, its override."""

    u: float
    rate: float
    override: float = 1.0


class ExecutorView:
    """Programs and axes of one machine.

    Args:
        machine: its axes, in the order of the executor's columns.
        newest: gives the newest cycle.
    """

    def __init__(self, machine: Machine, newest: Callable[[], FeedbackState]) -> None:
        self._newest = newest
        self._columns = {axis.index: column for column, axis in enumerate(machine.axes)}

    def energized(self) -> frozenset[int]:
        """Axes that hold a position or move."""
        condition = self._newest().condition
        return frozenset(
            index for index, column in self._columns.items() if int(condition[column]) in ENERGIZED
        )

    def homed(self) -> frozenset[int]:
        """Axes that know where they are."""
        mask = self._newest().homed
        return frozenset(index for index, column in self._columns.items() if mask >> column & 1)

    def positions(self) -> dict[int, float]:
        """Where motion starts from [m, rad]: the setpoint, or the encoder of an axis without energy."""
        latest = self._newest()
        live = np.isin(latest.condition, [int(condition) for condition in ENERGIZED])
        start = np.where(live, latest.setpoint, latest.actual)
        return {index: float(start[column]) for index, column in self._columns.items()}
