"""Compute the torques of setpoint rows, which limit changes of the playback rate."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.row_torques import NUMBERS, stop_cycles
from mcserver.motion.geometry.torque_limits import TorqueLimits
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.setpoint_sampling import CYCLE_ROUNDING
from mcserver.motion.pieces import Piece, Rows


class TorqueOfRows:
    """Torques of a program's rows, piece by piece.

    Args:
        cycle: between rows [s].

    Attributes:
        longest_stop: the longest stop that the torques so far need [cycles].
    """

    def __init__(self, limits: TorqueLimits, cycle: float) -> None:
        self._limits = limits
        self._cycle = cycle
        self._u: int | None = None
        self._velocity: Array = np.zeros(0)
        self.longest_stop = 0

    def on_plan(self, rows: Rows, plan: PlannedRun, origin: float) -> Rows:
        """Return rows of a plan that starts at u = ``origin`` with their torques."""
        time = (rows.first + np.arange(len(rows.line)) - origin) * self._cycle
        index = np.searchsorted(plan.times, time - CYCLE_ROUNDING * self._cycle) - 1
        index = np.clip(index, 0, len(plan.segments) - 1)
        return self.on(rows, [plan.segments[each].carried for each in index.tolist()])

    def on_pieces(self, pieces: Iterator[Piece], carried: tuple[int, ...]) -> Iterator[Piece]:
        """Yield the output of a line by itself, its rows with their torques."""
        for piece in pieces:
            yield self.on(piece, [carried] * len(piece.line)) if isinstance(piece, Rows) else piece

    def on(self, rows: Rows, carried: Sequence[tuple[int, ...]]) -> Rows:
        """Return rows, which follow those of the last call, with their torques.

        Args:
            carried: `Segment.carried` of each row.
        """
        position, velocity = rows.position, rows.velocity
        joined = rows.first - 1 == self._u
        before = self._velocity if joined else np.zeros_like(velocity[0])
        earlier = np.vstack([before[None], velocity[:-1]])
        mean, acceleration = 0.5 * (earlier + velocity), (velocity - earlier) / self._cycle
        self._u, self._velocity = rows.first + len(position) - 1, velocity[-1].copy()
        limits = self._limits
        found = np.empty((len(position), NUMBERS, len(limits.limits)))
        start = 0
        for tools, alike in groupby(carried):
            part = slice(start, start + len(list(alike)))
            found[part] = limits.of_rows(
                position[part], mean[part], acceleration[part], velocity[part] / self._cycle, tools
            )
            start = part.stop
        self.longest_stop = max(self.longest_stop, stop_cycles(found))
        return dataclasses.replace(rows, torque=found)
