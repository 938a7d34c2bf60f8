"""The motion of a simulated answer, by the coordinates that tasks name."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from mckinematics.solver import MachineKinematics
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.tool_poses import ToolPoses

Array = NDArray[np.float64]


class UnknownCoordinate(Exception):
    """A task names a coordinate that its machine lacks."""


class MotionRecord:
    """Setpoints of every cycle: ``X`` and ``7`` are axes, ``T3.X`` is a coordinate of a tool's pose.

    Attributes:
        time_s: shape (N,).
    """

    def __init__(self, recorded: Recorded, machine: Machine, kinematics: MachineKinematics | None) -> None:
        self.time_s: Array = recorded.time_s
        self._recorded = recorded
        self._poses = ToolPoses(machine, kinematics)
        self._scale = np.array([axis.type.si_per_unit for axis in machine.axes])
        self._column = {axis.index: at for at, axis in enumerate(machine.axes)}
        self._tools: dict[int, Array] = {}

    def path(self, names: Iterable[str]) -> Array:
        """Return the setpoints of coordinates [mm or deg], shape (N, len(names)).

        Raises:
            UnknownCoordinate: the machine has no such axis or tool.
        """
        return np.stack([self._coordinate(name) for name in names], axis=1)

    def final_speed(self, name: str, cycles: int = 10) -> float:
        """Return the mean speed of an axis over the last cycles, by its encoder [mm/s or deg/s]."""
        actual = self._recorded.actual[-cycles - 1 :, self._column_of(name)]
        time_s = self.time_s[-cycles - 1 :]
        return float((actual[-1] - actual[0]) / (time_s[-1] - time_s[0])) if len(actual) > 1 else 0.0

    def _coordinate(self, name: str) -> Array:
        tool, dot, letter = name.partition(".")
        if dot:
            return np.asarray(self._pose(int(tool[1:]))[:, "XYZABC".index(letter)])
        return self._recorded.setpoint[:, self._column_of(name)]

    def _column_of(self, name: str) -> int:
        axis = axis_number(name)
        if axis not in self._column:
            raise UnknownCoordinate(f"the machine has no axis {name}")
        return self._column[axis]

    def _pose(self, tool: int) -> Array:
        if tool not in self._poses.numbers:
            raise UnknownCoordinate(f"the machine has no tool T{tool}")
        if tool not in self._tools:
            self._tools[tool] = self._poses.of(tool, self._recorded.setpoint * self._scale)
        return self._tools[tool]


def axis_number(name: str) -> int:
    """Return the number of an axis by its letter, X to C, or by its number."""
    return "XYZABC".index(name) if name in "XYZABC" else int(name)
