"""Where the tools' tips go: the paths that are drawn in space, and the tips' frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from mckinematics.solver import MachineKinematics
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.simulation.recorder import Recorded
from mcserver.units import MM, AxisType
from mcserver.view.solids import Array

MOST_POINTS = 6000
# a tip that moves less than this has no path [m]
LEAST_TRAVEL = 1e-6


@dataclass(frozen=True)
class Track:
    """A path in space.

    Attributes:
        label: such as ``T3``; empty for the machine's own axes.
        points: shape (M, 3) [m]. line: shape (M,), the program's line at each point.
    """

    label: str
    points: Array
    line: NDArray[np.int64]

    def of_line(self, line: int) -> Array:
        """The stretch that belongs to a line, with the point that it begins at, shape (m, 3) [m]."""
        rows = np.flatnonzero(self.line == line)
        if line == 0 or not len(rows):
            return np.empty((0, 3))
        return self.points[max(0, rows[0] - 1) : rows[-1] + 1]


def portal_axes(machine: Machine) -> tuple[int, ...]:
    """Which of the axes 0, 1, 2 are linear: X, Y and Z of a machine without tools."""
    linear = (machine.axis(index) for index in range(3))
    return tuple(axis.index for axis in linear if axis is not None and axis.type is AxisType.LINEAR)


def work_zeros(machine: Machine, offsets: Iterable[Mapping[str, Any]]) -> dict[str, Array]:
    """Where work coordinate systems read zero, shape (3,) [m], by name; empty for a machine with tools.

    Args:
        offsets: ``work_offsets`` of a simulation's report or of a status, as maps with ``system`` and
            ``origin`` [mm]. With any, the machine's zero is there too.
    """
    axes = portal_axes(machine)
    systems = list(offsets)
    if machine.tools or not axes or not systems:
        return {}
    zeros = {"machine": np.zeros(3)}
    for each in systems:
        zeros[each["system"]] = np.zeros(3)
        for axis in axes:
            zeros[each["system"]][axis] = float(each["origin"].get(str(axis), 0.0)) * MM
    return zeros


def tip_frames(
    machine: Machine, kinematics: MachineKinematics | None, positions: Mapping[int, float]
) -> dict[str, Array]:
    """Each tool's frame, shape (4, 4), by its label; without tools none."""
    frames = {}
    tools = {} if kinematics is None else {tool: kinematics.tool(tool).chain for tool in kinematics.tools}
    for tool, chain in tools.items():
        place, turn = chain.forward(np.array([[positions[axis] for axis in chain.axes]]))
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = turn[0], place[0]
        frames[f"T{tool}"] = frame
    if not frames and portal_axes(machine):
        frame = np.eye(4)
        frame[:3, 3] = portal_points(machine, {axis: np.array([at]) for axis, at in positions.items()})[0]
        frames[""] = frame
    return frames


def tracks_of(
    machine: Machine, kinematics: MachineKinematics | None, recording: Recorded
) -> tuple[Track, ...]:
    """The setpoints' paths of all tips that move, of `MOST_POINTS` points at most."""
    count = len(recording.time_s)
    if count < 2:
        return ()
    rows = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(np.int64))
    line = np.asarray(recording.line)[rows].astype(np.int64)
    positions = positions_at(machine, recording, rows)
    if kinematics is None or not kinematics.tools:
        paths = {"": portal_points(machine, positions)} if portal_axes(machine) else {}
    else:
        paths = {}
        for tool in kinematics.tools:
            chain = kinematics.tool(tool).chain
            paths[f"T{tool}"] = chain.forward(np.stack([positions[axis] for axis in chain.axes], axis=1))[0]
    return tuple(
        Track(label, points, line)
        for label, points in paths.items()
        if np.ptp(points, axis=0).max() > LEAST_TRAVEL
    )


def positions_at(machine: Machine, recording: Recorded, rows: NDArray[np.int64]) -> dict[int, Array]:
    """Setpoints of all axes in these rows, by axis number, shape (n,) each [m or rad]."""
    by_index = {axis.index: axis for axis in machine.axes}
    return {
        int(number): recording.setpoint[rows, column] * by_index[int(number)].type.si_per_unit
        for column, number in enumerate(recording.axes)
    }


def portal_points(machine: Machine, positions: Mapping[int, Array]) -> Array:
    """X Y Z of a machine without tools, shape (n, 3) [m]; axes that it lacks stay at 0."""
    count = len(next(iter(positions.values())))
    points = np.zeros((count, 3))
    for axis in portal_axes(machine):
        points[:, axis] = positions[axis]
    return points
