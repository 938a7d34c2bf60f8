"""Setpoints of a simulated run at moments evenly in time, bounded however long it is: for charts of its axes.

`mcserver.simulation.path_sampler` keeps points evenly along the path instead, which a pause adds nothing to.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.simulation.tool_poses import ToolPoses

Array = NDArray[np.float64]

# moments of one path, and values of all its columns: about 150 kB on the wire
MAX_MOMENTS = 2000
MAX_VALUES = 16_384
LEAST_MOMENTS = 128


def moments_for(columns: int) -> int:
    """Return how many moments a path of so many columns may have."""
    return int(np.clip(MAX_VALUES // max(1, columns), LEAST_MOMENTS, MAX_MOMENTS))


class TimeSampler:
    """Keeps rows evenly in time: where there is no room for more, every second one is dropped.

    Args:
        moments: the most rows that are kept.
        width: setpoints in a row.
    """

    def __init__(self, moments: int, width: int) -> None:
        self._moments = moments
        # those of every so many cycles, the first one of all among them
        self._kept = np.empty((0, 1 + width))
        self._stride = 1
        self._seen = 0
        self._last = self._kept

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:  # noqa: ARG002
        """Look at cycles: times (n,) [s], setpoints (n, width)."""
        rows = np.column_stack((times, setpoint))
        self._kept = np.concatenate((self._kept, rows[-self._seen % self._stride :: self._stride]))
        while len(self._kept) > self._moments:
            self._kept, self._stride = self._kept[::2], 2 * self._stride
        self._seen += len(rows)
        self._last = rows[-1:]

    @property
    def rows(self) -> Array:
        """Time and setpoints, shape (n, 1 + width); the newest cycle is always the last row."""
        behind = self._last[:, :1] != self._kept[-1:, :1]
        return np.concatenate((self._kept, self._last[behind.any(axis=1)]))


def path_of(sampler: TimeSampler, machine: Machine, poses: ToolPoses, axes: Sequence[int]) -> dict[str, Any]:
    """Return a path as plain values, in mm and degrees.

    Args:
        axes: whose positions are wanted; of tools those that any of these axes move.

    Returns:
        ``time_s`` (n), ``positions``: n values for each of ``axes``, ``tools``: number and X, Y, Z
        (n values each).
    """
    rows = sampler.rows
    column = {axis.index: at for at, axis in enumerate(machine.axes)}
    scale = np.array([axis.type.si_per_unit for axis in machine.axes])
    moved = {number for number in poses.numbers if set(poses.axes(number)) & set(axes)}
    return {
        "time_s": rows[:, 0].tolist(),
        "positions": [(rows[:, 1 + column[axis]] / scale[column[axis]]).tolist() for axis in axes],
        "tools": [
            {"tool": number, "position": poses.of(number, rows[:, 1:])[:, :3].T.tolist()}
            for number in sorted(moved)
        ],
    }
