"""Output of the planner besides rows: marks of lines, and the columns that rows drive."""

from __future__ import annotations

import msgspec

from mcserver.motion.bound import Bound
from mcserver.motion.profile.setpoint_sampling import Rows

# Rows in one piece of output.
PIECE = 1000


class LineMark(msgspec.Struct, frozen=True):
    """A line begins or ends at u [cycles]."""

    u: float
    line: int
    ends: bool


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


Piece = Rows | LineMark | LineBound | Activation | Deactivation
