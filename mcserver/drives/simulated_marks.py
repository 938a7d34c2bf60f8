"""What lies along the travel of simulated axes: home switches, the encoders' indices, hard stops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcserver.drives.bus import HOME_SWITCH, Array, Feedback
from mcserver.machine.axis import Axis


class SimulatedMarks:
    """Switches, indices and stops of n axes, by their encoders.

    A switch's edge and an index are latched where they lie, as drives with a capture unit do.

    Attributes:
        present: some axis has a switch or an index. stops: some axis has hard stops.
        low, high: shape (n,), where the mechanics end [m or rad]; infinite without stops.
    """

    def __init__(self, axes: Sequence[Axis]) -> None:
        scales = [axis.type.si_per_unit for axis in axes]
        drives = [axis.drive for axis in axes]
        stops = [drive.hard_stops or (-np.inf, np.inf) for drive in drives]
        self.low: Array = np.array([min(each) for each in stops]) * scales
        self.high: Array = np.array([max(each) for each in stops]) * scales
        self.stops = any(drive.hard_stops is not None for drive in drives)
        # row 0: from where the switch is active, row 1: to where; NaN: no switch
        ranges = [sorted(drive.home_switch or (np.nan, np.nan)) for drive in drives]
        self._switch: Array = np.array(ranges).reshape(-1, 2).T * scales
        self._index: Array = np.array(
            [
                np.nan if drive.index_at is None else drive.index_at * scale
                for drive, scale in zip(drives, scales, strict=True)
            ]
        )
        self._pitch: Array = np.array([axis.travel_per_motor_turn for axis in axes])
        self.present = not (np.isnan(self._switch).all() and np.isnan(self._index).all())
        self._before: Array = np.zeros(len(axes))

    def place(self, position: Array, feedback: Feedback) -> None:
        """Take positions, shape (n,) [m or rad], as those at the start."""
        self._before[:] = position
        feedback.inputs[:] = np.where(self._active(position), HOME_SWITCH, 0)

    def pass_to(self, position: Array, feedback: Feedback) -> None:
        """Report what was passed on the way from the positions before to these, shape (n,) [m or rad]."""
        before = self._before
        active = self._active(position)
        changed = active != self._active(before)
        if changed.any():
            for edge in self._switch:
                crossed = changed & ((before < edge) != (position < edge))
                np.copyto(feedback.switch_at, edge, where=crossed)
            feedback.inputs[:] = np.where(active, HOME_SWITCH, 0)
        turns = np.floor((position - self._index) / self._pitch)
        turns_before = np.floor((before - self._index) / self._pitch)
        passed = (turns != turns_before) & ~np.isnan(self._index)
        if passed.any():
            nearest = np.maximum(turns, turns_before)
            np.copyto(feedback.index_at, self._index + nearest * self._pitch, where=passed)
            feedback.indices[passed] += 1
        before[:] = position

    def _active(self, position: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        active: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = (position >= self._switch[0]) & (
            position <= self._switch[1]
        )
        return active
