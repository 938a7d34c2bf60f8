"""What planning gives besides rows: marks of lines, and which columns rows drive."""

from __future__ import annotations

from dataclasses import dataclass

from mcserver.motion.node import Bound
from mcserver.motion.sampling import Rows

# Rows in one piece of output.
PIECE = 500


@dataclass(frozen=True)
class LineMark:
    """A line begins or ends at u [cycles]."""

    u: float
    line: int
    ends: bool


@dataclass(frozen=True)
class LineBound:
    """A limit has stretched the line."""

    line: int
    bound: Bound


@dataclass(frozen=True)
class Activation:
    """Rows drive the columns of ``mask`` from u on."""

    u: float
    line: int
    mask: int


@dataclass(frozen=True)
class Deactivation:
    """Rows have stopped to drive the columns of ``mask`` at u; ``position`` (K,) is where they stay."""

    u: float
    line: int
    mask: int
    position: tuple[float, ...]


Piece = Rows | LineMark | LineBound | Activation | Deactivation
