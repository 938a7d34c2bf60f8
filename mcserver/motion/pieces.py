"""Output of the planner: rows, where lines begin and end, and the columns that rows drive."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import Bound

# Rows in one piece of output.
PIECE = 1000


@dataclass(frozen=True)
class Rows:
    """Setpoint rows at u = first, first + 1, …

    Attributes:
        first: u of the first row; what lies between the row before and it is not driven by rows (waits).
        position, velocity: shape (n, K) [m, rad; per second]; read only where the mask says.
        axes: bit mask of the columns that each row drives, shape (n,).
        line: number of the line that each row belongs to, shape (n,).
        torque: what each row asks of joints with limited torque, shape (n, 3, J) (`row_torques`); None: of
            none.
        feed_scale: feed override that each row is planned for, shape (n,) [1]; None: all 1.
    """

    first: int
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    axes: NDArray[np.uint64]
    line: NDArray[np.int64]
    torque: NDArray[np.float64] | None = None
    feed_scale: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.line)

    def part(self, start: int, end: int) -> Rows:
        """Return the rows at these places."""
        part = slice(start, end)
        return Rows(
            self.first + start,
            self.position[part],
            self.velocity[part],
            self.axes[part],
            self.line[part],
            None if self.torque is None else self.torque[part],
            None if self.feed_scale is None else self.feed_scale[part],
        )


@dataclass(frozen=True, eq=False)
class LineEdges:
    """Where lines begin and end, in columns.

    Attributes:
        u: in order, shape (n,) [cycles]. line: their numbers. ends: which of them end, the others begin.
    """

    u: NDArray[np.float64]
    line: NDArray[np.int64]
    ends: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.u)

    def part(self, part: slice) -> LineEdges:
        """Return some of them."""
        return LineEdges(self.u[part], self.line[part], self.ends[part])


class LineBound(msgspec.Struct, frozen=True):
    """A limit has stretched the line."""

    line: int
    bound: Bound


class Activation(msgspec.Struct, frozen=True):
    """Rows drive the columns of ``mask`` from u on."""

    u: float
    line: int
    mask: int


class Deactivation(msgspec.Struct, frozen=True):
    """Rows no longer drive the columns of ``mask`` from u on; ``position`` (K,) is where they stay."""

    u: float
    line: int
    mask: int
    position: tuple[float, ...]


Piece = Rows | LineEdges | LineBound | Activation | Deactivation
