"""Coordinates of a run by their names: axes as programs write them, and those of a tool's pose."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mcserver.errors import Refused
from mcserver.gcode.text.words import ABSOLUTE_LETTERS
from mcserver.machine.machine_file import Machine
from mcserver.simulation.tool_poses import ToolPoses

if TYPE_CHECKING:
    from mckinematics.solver import MachineKinematics

Array = NDArray[np.float64]

POSE = "XYZABC"
_TOOL = re.compile(r"T([0-9]{1,4})(?:\.([XYZABC]))?")


class Coordinates:
    """Find values by names in rows of setpoints: ``X`` and ``7`` are axes, ``T3.X`` is of tool 3's pose.

    Args:
        kinematics: of the machine's tools; None: names of tools are refused.
    """

    def __init__(self, machine: Machine, kinematics: MachineKinematics | None) -> None:
        self._machine = machine
        self._poses = ToolPoses(machine, kinematics)
        self._scale = np.array([axis.type.si_per_unit for axis in machine.axes])
        self._column = {axis.index: at for at, axis in enumerate(machine.axes)}
        # poses of the rows that were asked of last
        self._rows: Array | None = None
        self._of_tool: dict[int, Array] = {}

    def of(self, name: str, setpoint: Array) -> Array:
        """Return the values of a coordinate [mm or deg], shape (n,).

        Args:
            setpoint: of all axes, shape (n, K) [SI].

        Raises:
            Refused: MC331 the machine has no such axis or tool.
        """
        tool, letter = self._tool_of(name)
        if tool is None:
            column = self.column(name)
            return np.asarray(setpoint[:, column] / self._scale[column])
        if letter is None:
            raise Refused("MC331", f"{name} is a tool, not a coordinate", f"such as {name}.X")
        return self.pose(tool, setpoint)[:, POSE.index(letter)]

    def pose(self, tool: int, setpoint: Array) -> Array:
        """Return the poses of a tool, shape (n, 6): X Y Z [mm], A B C [deg]; arguments and errors as `of`."""
        if tool not in self._poses.numbers:
            raise Refused("MC331", f"the machine has no tool T{tool}", self._known())
        if self._rows is not setpoint:
            self._rows = setpoint
            self._of_tool.clear()
        if tool not in self._of_tool:
            self._of_tool[tool] = self._poses.of(tool, setpoint)
        return self._of_tool[tool]

    def speed(self, name: str, setpoint: Array, cycle_s: float) -> Array:
        """Return the speed of an axis, or of a tool's tip as ``T3``, in each cycle but the first.

        Returns:
            Shape (n - 1,) [mm/s or deg/s], never negative; arguments and errors as `of`.
        """
        tool, letter = self._tool_of(name)
        if tool is not None and letter is None:
            step = np.linalg.norm(np.diff(self.pose(tool, setpoint)[:, :3], axis=0), axis=1)
        else:
            step = np.abs(np.diff(self.of(name, setpoint)))
        return np.asarray(step / cycle_s)

    def column(self, name: str) -> int:
        """Return the column of an axis by its letter, or by its number.

        Raises:
            Refused: MC331 the machine has no such axis.
        """
        letters = {**ABSOLUTE_LETTERS, **self._machine.dialect.letters}
        axis = letters.get(name, int(name) if re.fullmatch(r"[0-9]{1,4}", name) else -1)
        if axis not in self._column:
            raise Refused("MC331", f"the machine has no axis {name[:40]}", self._known())
        return self._column[axis]

    def axes_of_tool(self, name: str) -> frozenset[int]:
        """Return the axes that move the tool of a coordinate; none for the name of an axis."""
        tool, _ = self._tool_of(name)
        return frozenset() if tool is None else frozenset(self._poses.axes(tool))

    def _tool_of(self, name: str) -> tuple[int | None, str | None]:
        found = _TOOL.fullmatch(name)
        return (None, None) if found is None else (int(found[1]), found[2])

    def _known(self) -> str:
        axes = ", ".join(str(axis) for axis in self._column)
        tools = ", ".join(f"T{tool}" for tool in self._poses.numbers)
        return f"it has the axes {axes}" + (f" and the tools {tools}, as T1.X" if tools else "")
