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
    """Rows at u = first, first + 1, …: positions and velocities (n, K), masks and lines (n,), and what they
    ask of joints whose torques are limited (n, 3, J), see `row_torques`; None without limits. The feed scales
    that they are planned at (n,); None: all 1.
    """

    first: int
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    axes: NDArray[np.uint64]
    line: NDArray[np.int64]
    torque: NDArray[np.float64] | None = None
    feed_scale: NDArray[np.float64] | None = None


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
