"""What the words of a line mean that is read in columns; whatever is not in it is read line by line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from mcserver.gcode.text.words import INCREMENTAL_LETTERS, axis_letters
from mcserver.machine.dialect_section import Dialect

OFFSETS: Final = "IJK"


class Vocabulary(NamedTuple):
    """The words of a dialect that lines in columns may have.

    Attributes:
        axes: letter → axis. codes: number of a motion code as written → the code that it means.
        feed_of_axes: F counts the axes by their words (D-30); else those of X Y Z first (D-66).
        idle: letters of words without effect on motion: S where nothing follows it, E without an extruder.
        speed: S is kept in the frame.
    """

    axes: Mapping[str, int]
    codes: Mapping[bytes, int]
    feed_of_axes: bool
    idle: str
    speed: bool


def vocabulary_of(dialect: Dialect) -> Vocabulary:
    """Return the vocabulary of a machine's dialect."""
    axes = {
        letter: axis
        for letter, axis in axis_letters(dialect).items()
        if letter not in INCREMENTAL_LETTERS or letter in dialect.letters
    }
    printer = dialect.profile == "printer"
    # printers move G0 and G1 alike (D-61)
    codes = {0: 1 if printer else 0, 1: 1, 2: 2, 3: 3}
    followed = dialect.spindle is not None or any(
        each.value is None for code in ("M3", "M4") for each in dialect.outputs.get(code, ())
    )
    speed = not (dialect.reference or followed or "S" in axes)
    return Vocabulary(
        axes,
        {(b"0" * zeros) + b"%d" % code: meant for code, meant in codes.items() for zeros in range(3)},
        dialect.reference,
        ("S" if speed else "") + ("E" if printer and "E" not in axes else ""),
        speed,
    )
