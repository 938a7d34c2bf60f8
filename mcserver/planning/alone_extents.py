"""Bound the positions of axes that the executor moves by itself: during the motion, and after it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mcserver.executor.entries import Control, ControlKind
from mcserver.machine.axis import Axis
from mcserver.planning.shared_space import Extent, Mask

# Kinds whose motion is on a straight line.
STRAIGHT = (ControlKind.PROBE, ControlKind.THREAD)


class AloneExtents:
    """Bound rapids, probing, homing, speeds, torques and streamed targets, at any timing by holds, overrides
    and stops.

    Args:
        axes: by column. anywhere: returns the travel of a column, given where it stands.

    Attributes:
        follow_from: lower bounds of the streamed targets to come, shape (K,).
    """

    def __init__(self, axes: Sequence[Axis], anywhere: Callable[[int, float], tuple[float, float]]) -> None:
        self._axes = axes
        self._anywhere = anywhere
        self.follow_from: tuple[float, ...] | None = None

    def extents(self, control: Control, columns: Mask, extent: Extent) -> tuple[Extent, Extent]:
        """Return where columns may be during the motion of an entry, and after it.

        Args:
            columns: that the entry moves. extent: where all columns may be as it begins.
        """
        low, high = extent.low.copy(), extent.high.copy()
        ends = Extent(low, high)
        if control.kind is ControlKind.RAPID or control.kind in STRAIGHT:
            target = np.array(control.values)
            for column in np.flatnonzero(columns & (low != high)).tolist():
                # it is moving already, and may overrun and come back
                overrun = _stopping_distance(self._axes[column])
                low[column] -= overrun
                high[column] += overrun
            low[columns] = np.minimum(low, target)[columns]
            high[columns] = np.maximum(high, target)[columns]
        elif control.kind is ControlKind.HOME:
            ends = Extent(low.copy(), high.copy())
            for column in np.flatnonzero(columns).tolist():
                self._homing_extent(column, Extent(low, high), ends)
        elif control.kind is ControlKind.FOLLOW and control.values and self.follow_from:
            low[columns] = np.minimum(low, self.follow_from)[columns]
            high[columns] = np.maximum(high, control.values)[columns]
        else:
            for column in np.flatnonzero(columns).tolist():
                low[column], high[column] = self._anywhere(column, float(low[column]))
        return Extent(low, high), ends

    def _homing_extent(self, column: int, swept: Extent, ends: Extent) -> None:
        """Widen the extents of an axis by the motion of its homing.

        Args:
            swept, ends: extents during the homing and after it, which contain its present position; changed.
        """
        axis = self._axes[column]
        homing = axis.homing
        here = float(swept.low[column]), float(swept.high[column])
        least, most = self._anywhere(column, here[0])
        if homing is None or homing.method == "drive":
            swept.low[column], swept.high[column] = min(here[0], least), max(here[1], most)
            ends.low[column], ends.high[column] = swept.low[column], swept.high[column]
            return
        home = homing.position or 0.0
        beyond = 2.0 * homing.back_off
        rest = (home - beyond, home + beyond)
        if homing.then_move_to is not None:
            rest = (homing.then_move_to, homing.then_move_to)
        # off a switch that is active, then towards it, within the axis's travel
        far = sorted((-homing.direction * homing.release_travel, homing.direction * homing.travel))
        low, high = max(least, here[0] + far[0]), min(most, here[1] + far[1])
        swept.low[column] = min(low, here[0], home, rest[0]) - beyond
        swept.high[column] = max(high, here[1], home, rest[1]) + beyond
        ends.low[column], ends.high[column] = rest


def _stopping_distance(axis: Axis) -> float:
    """Return the longest stopping distance of an axis [m or rad]."""
    ramp = axis.max_velocity / axis.max_acceleration + axis.max_acceleration / axis.max_jerk
    return axis.max_velocity * ramp
