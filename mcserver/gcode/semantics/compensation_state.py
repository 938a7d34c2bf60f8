"""Cutter compensation in force between two lines, an immutable value (D-85)."""

from __future__ import annotations

import msgspec

from mcserver.gcode.semantics.arc_geometry import Point
from mcserver.gcode.semantics.offset_path import Piece
from mcserver.motion.canonical import Canonical, MotionLine


class HeldMove(msgspec.Struct, frozen=True):
    """The last move in the plane: where it ends is known when the next one is.

    Attributes:
        line: as it was programmed. whole: its path beside the programmed one.
        piece: what is left of it behind the corner at its start. begin: where the cutter's centre is then.
        behind: what comes behind it and ahead of the next one.
    """

    line: MotionLine
    whole: Piece
    piece: Piece
    begin: Point
    behind: tuple[Canonical, ...] = ()


class Compensation(msgspec.Struct, frozen=True):
    """G41 or G42, and G40 until the cutter is back on the programmed path.

    Attributes:
        side: 1 left of the path, -1 right of it, 0 on the way back.
        radius: of the cutter [m]. plane: its two axes. line: of G41 or G42.
        place: where the cutter's centre stands, off the programmed path; None: on it, or where ``held`` ends.
        held: None before the way in and behind G40. lost: of a check, a fault came in between.
    """

    side: int
    radius: float
    plane: tuple[int, int]
    line: int
    place: Point | None = None
    held: HeldMove | None = None
    lost: bool = False
