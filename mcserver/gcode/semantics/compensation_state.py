"""Cutter compensation in force between two lines, as an immutable value (D-85)."""

from __future__ import annotations

import msgspec

from mcserver.gcode.semantics.arc_geometry import Point
from mcserver.gcode.semantics.offset_path import Piece
from mcserver.motion.canonical import Canonical, MotionLine


class HeldMove(msgspec.Struct, frozen=True):
    """The last move in the plane, whose end is not known before the next move.

    Attributes:
        line: as programmed. whole: its offset path.
        piece: what the corner at its start leaves of that path. begin: position of the cutter's centre there.
        behind: values after it and before the next move.
    """

    line: MotionLine
    whole: Piece
    piece: Piece
    begin: Point
    behind: tuple[Canonical, ...] = ()


class Compensation(msgspec.Struct, frozen=True):
    """G41 or G42, and G40 until the cutter is back on the programmed path.

    Attributes:
        side: 1 left of the path, -1 right of it, 0 during the lead-out.
        radius: of the cutter [m]. plane: its two axes. line: of G41 or G42.
        place: position of the cutter's centre off the path; None: on the path, or at the end of ``held``.
        held: None before the lead-in and after G40. lost: in checks, after a fault.
    """

    side: int
    radius: float
    plane: tuple[int, int]
    line: int
    place: Point | None = None
    held: HeldMove | None = None
    lost: bool = False
