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
    """How many moments a path of so many columns may have."""
    return int(np.clip(MAX_VALUES // max(1, columns), LEAST_MOMENTS, MAX_MOMENTS))


class TimeSampler:
    """Keeps rows evenly in time: where there is no room for more, every second one is dropped.

    Args:
        moments: the most rows that are kept, at least 4.
        width: setpoints in a row.
    """

    def __init__(self, moments: int, width: int) -> None:
        self._rows = np.empty((moments, 1 + width))
        self._fill = 0
        self._stride = 1
        self._seen = 0
        self._last = np.empty(0)

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:  # noqa: ARG002
        """Look at cycles: times (n,) [s], setpoints (n, width)."""
        # the next cycle that is kept
        at = -self._seen % self._stride
        while at < len(times):
            wanted = np.arange(at, len(times), self._stride)[: len(self._rows) - self._fill]
            stop = self._fill + len(wanted)
            self._rows[self._fill : stop, 0] = times[wanted]
            self._rows[self._fill : stop, 1:] = setpoint[wanted]
            self._fill = stop
            at = int(wanted[-1]) + self._stride
            if self._fill == len(self._rows):
                at = self._thin(at)
        self._seen += len(times)
        self._last = np.concatenate([[times[-1]], setpoint[-1]])

    def _thin(self, next_kept: int) -> int:
        """Keep every second row; the next cycle to keep, at the stride that has doubled."""
        kept = self._rows[: self._fill : 2]
        odd = self._fill % 2 == 1
        self._rows[: len(kept)] = kept
        self._fill = len(kept)
        step, self._stride = self._stride, 2 * self._stride
        # of an even count the newest row was dropped, and the next cycle is of the new stride
        return next_kept + step if odd else next_kept

    @property
    def rows(self) -> Array:
        """Time and setpoints, shape (n, 1 + width); the newest cycle is always the last row."""
        kept = self._rows[: self._fill]
        if len(self._last) and (not len(kept) or kept[-1, 0] != self._last[0]):
            kept = np.vstack([kept, self._last])
        return kept.copy()


def path_of(sampler: TimeSampler, machine: Machine, poses: ToolPoses, axes: Sequence[int]) -> dict[str, Any]:
    """A path as plain values, in mm and degrees.

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
