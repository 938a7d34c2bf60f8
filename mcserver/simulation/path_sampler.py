"""The path of a simulated run in as many points as a picture needs, whatever the run's length."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.simulation.tool_poses import ToolPoses
from mcserver.units import MM, AxisType

Array = NDArray[np.float64]

# Points lie this far apart along the axes' travel [m or rad] until there are too many; then twice as far.
FIRST_STEP = 1e-5


class PathSampler:
    """Keeps points at even distances along the travel of the axes that move a tip.

    Args:
        poses: of the machine's tools; without tools the tip is where the axes 0, 1 and 2 are.
        most: points that are kept at most.
    """

    def __init__(self, machine: Machine, poses: ToolPoses, most: int) -> None:
        self._poses = poses
        self._most = most
        numbers = [axis.index for axis in machine.axes]
        carrying = {axis for tool in machine.tools for axis in tool.axes}
        self._portal = [
            column
            for column, axis in enumerate(machine.axes)
            if axis.index < 3 and axis.type is AxisType.LINEAR
        ]
        self._letters = [numbers[column] for column in self._portal]
        self._columns = [numbers.index(axis) for axis in sorted(carrying)] if carrying else self._portal
        self._step = FIRST_STEP
        self._travelled = 0.0
        self._last: Array | None = None
        self._kept: list[tuple[float, int, Array]] = []

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:  # noqa: ARG002
        """Take cycles in order: lines (n,), setpoints (n, K) [SI]."""
        if not self._columns or not len(lines):
            return
        moving = setpoint[:, self._columns]
        before = moving[:1] if self._last is None else self._last[None]
        travel = self._travelled + np.abs(np.diff(moving, axis=0, prepend=before)).max(axis=1).cumsum()
        cell = np.floor(travel / self._step)
        first = -1.0 if self._last is None else np.floor(self._travelled / self._step)
        chosen = np.flatnonzero(np.diff(cell, prepend=first) > 0.0)
        self._kept += [(float(travel[row]), int(lines[row]), setpoint[row].copy()) for row in chosen]
        self._travelled, self._last = float(travel[-1]), moving[-1].copy()
        self._newest = (self._travelled, int(lines[-1]), setpoint[-1].copy())
        if len(self._kept) > self._most:
            self._thin()

    def path(self) -> dict[str, Any]:
        """Return ``lines`` (n,), and ``tips``: of each ``tool`` (None: the axes' own) its ``points`` [mm]."""
        kept = list(self._kept)
        if kept and self._newest[0] > kept[-1][0]:
            kept.append(self._newest)
        if len(kept) < 2:
            return {"lines": [], "tips": []}
        rows = np.array([row for _, _, row in kept])
        tips: list[dict[str, Any]] = [
            {"tool": tool, "points": np.round(self._poses.of(tool, rows)[:, :3], 4).tolist()}
            for tool in self._poses.numbers
        ]
        if not tips:
            points = np.zeros((len(rows), 3))
            points[:, self._letters] = rows[:, self._portal] / MM
            tips.append({"tool": None, "points": np.round(points, 4).tolist()})
        return {"lines": [line for _, line, _ in kept], "tips": tips}

    def _thin(self) -> None:
        while len(self._kept) > self._most // 2:
            self._step *= 2.0
            thinned: list[tuple[float, int, Array]] = []
            cell = -1.0
            for each in self._kept:
                here = each[0] // self._step
                if here > cell:
                    thinned.append(each)
                    cell = here
            self._kept = thinned
