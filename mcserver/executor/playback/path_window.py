"""The rows about u as one array, to look at setpoints that are still to come."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.headroom import Array
from mcserver.executor.playback.interpolation import between_rows


@dataclass(frozen=True)
class PathWindow:
    """Rows of the columns that move.

    Attributes:
        columns: of the machine, shape (K,). u: of the rows, shape (m,), increasing [cycles].
        position, velocity: shape (m, K) [m or rad, per s]. most: as of `between_rows`, shape (K,) [per s²].
            cycle: [s]. ends: the last row is the motion's own end.
    """

    columns: NDArray[np.intp]
    u: Array
    position: Array
    velocity: Array
    most: Array
    cycle: float
    ends: bool

    def at(self, u: Array) -> Array:
        """Return positions at u (n,), shape (n, K); those beyond the last row stay there."""
        last = len(self.u) - 1
        if last == 0:
            return np.tile(self.position[0], (len(u), 1))
        index = np.clip(np.searchsorted(self.u, u, side="right") - 1, 0, last - 1)
        span = self.u[index + 1] - self.u[index]
        share = np.clip((u - self.u[index]) / span, 0.0, 1.0)[:, None]
        position, _ = between_rows(
            self.position[index],
            self.position[index + 1],
            self.velocity[index],
            self.velocity[index + 1],
            share,
            (span * self.cycle)[:, None],
            self.most,
        )
        return position

    def row_differences(self) -> tuple[Array, Array, Array]:
        """Return the absolute first to third differences of the rows, each shape (m, K), 0 where one is
        lacking.

        Difference n at a row spans that row and the n before it.
        """
        found = []
        for order in (1, 2, 3):
            each = np.zeros_like(self.position)
            if len(self.u) > order:
                each[order:] = np.abs(np.diff(self.position, order, axis=0))
            found.append(each)
        return found[0], found[1], found[2]
