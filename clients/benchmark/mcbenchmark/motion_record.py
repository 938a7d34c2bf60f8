"""The motion of a simulated answer, by the coordinates that tasks name."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from mckinematics.solver import MachineKinematics
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.simulation.coordinates import Coordinates
from mcserver.simulation.recorder import Recorded

Array = NDArray[np.float64]


class MotionRecord:
    """Setpoints of every cycle: ``X`` and ``7`` are axes, ``T3.X`` is a coordinate of a tool's pose.

    Attributes:
        time_s, line: shape (N,). setpoint: of all axes, shape (N, K) [SI].
    """

    def __init__(self, recorded: Recorded, machine: Machine, kinematics: MachineKinematics | None) -> None:
        self.time_s: Array = recorded.time_s
        self.line = recorded.line.astype(np.int64)
        scale = np.array([axis.type.si_per_unit for axis in machine.axes])
        self.setpoint: Array = recorded.setpoint * scale
        self._actual = recorded.actual
        self._machine = machine
        self._coordinates = Coordinates(machine, kinematics)

    def path(self, names: Iterable[str]) -> Array:
        """Return the setpoints of coordinates [mm or deg], shape (n, len(names)).

        Raises:
            Refused: MC331 the machine has no such axis or tool.
        """
        return np.stack([self._coordinates.of(name, self.setpoint) for name in names], axis=1)

    def final_speed(self, name: str, cycles: int = 10) -> float:
        """Return the mean speed of an axis over the last cycles, by its encoder [mm/s or deg/s]."""
        actual = self._actual[-cycles - 1 :, self._coordinates.column(name)]
        time_s = self.time_s[-cycles - 1 :]
        return float((actual[-1] - actual[0]) / (time_s[-1] - time_s[0])) if len(actual) > 1 else 0.0

    def one_name(self, name: str) -> str:
        """Return the one name of a coordinate: an axis by its number; errors as `path`."""
        return name if "." in name else str(self._machine.axes[self._coordinates.column(name)].index)

    def judged(self, named: Iterable[str]) -> tuple[str, ...]:
        """Return all coordinates that a task is judged by that names some of them, by `one_name`.

        Of a tool that is named these are its pose's, its orientation where the machine keeps that; of the
        axes those that no such tool moves, and those that are named themselves.
        """
        named = tuple(map(self.one_name, named))
        tools = {int(name[1:].partition(".")[0]) for name in named if "." in name}
        moved = {axis for name in named for axis in self._coordinates.axes_of_tool(name)}
        own = {axis.index for axis in self._machine.axes} - moved
        own |= {int(name) for name in named if "." not in name}
        letters = {tool.number: "XYZABC" if tool.orientation else "XYZ" for tool in self._machine.tools}
        poses = [f"T{tool}.{letter}" for tool in sorted(tools) for letter in letters[tool]]
        return (*map(str, sorted(own)), *poses)


def axis_number(name: str) -> int:
    """Return the number of an axis by its letter, X to C, or by its number."""
    return "XYZABC".index(name) if name in "XYZABC" else int(name)
