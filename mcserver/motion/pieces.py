"""Output of the planner: setpoint rows, where lines begin and end, and which columns the rows drive."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import Bound

# Most rows in one piece of output.
PIECE = 1000


@dataclass(frozen=True)
class Rows:
    """Setpoint rows at u = first, first + 1, …

    Attributes:
        first: u of the first row; between pieces of rows there may be gaps (waits).
        position, velocity: shape (n, K) [m, rad; per second]; read only where the mask says.
        axes: bit mask of the columns that each row drives, shape (n,).
        line: number of the line that each row belongs to, shape (n,).
        torque: load of each row on the joints with limited torque, shape (n, 3, J) (`row_torques`); None: no
            joint has a limit.
        feed_scale: feed scale that each row is planned for, shape (n,) [1]; None: all 1.
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
        """Return rows ``start`` … ``end`` - 1."""
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
        u: non-decreasing, shape (n,) [cycles]. line: numbers of the lines. ends: True where a line ends,
            False where one begins.
    """

    u: NDArray[np.float64]
    line: NDArray[np.int64]
    ends: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.u)

    def part(self, part: slice) -> LineEdges:
        """Return the edges of a slice."""
        return LineEdges(self.u[part], self.line[part], self.ends[part])


class LineBound(msgspec.Struct, frozen=True):
    """A limit makes the line take longer than requested."""

    line: int
    bound: Bound


class Activation(msgspec.Struct, frozen=True):
    """Rows drive the columns of ``mask`` from u on."""

    u: float
    line: int
    mask: int


class Deactivation(msgspec.Struct, frozen=True):
    """Rows no longer drive the columns of ``mask`` from u on; these stay at ``position`` (K,)."""

    u: float
    line: int
    mask: int
    position: tuple[float, ...]


Piece = Rows | LineEdges | LineBound | Activation | Deactivation
