"""Words: a letter or ``[n]``, and a number."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from mcserver.machine.dialect_section import Dialect

AXIS_LETTERS: Mapping[str, int] = MappingProxyType(
    {"X": 0, "Y": 1, "Z": 2, "A": 3, "B": 4, "C": 5, "U": 0, "V": 1, "W": 2}
)


def axis_letters(dialect: Dialect) -> dict[str, int]:
    """Return the axis that each letter names on a machine with this dialect."""
    return {**AXIS_LETTERS, **dialect.letters}


INCREMENTAL_LETTERS = frozenset("UVW")
ABSOLUTE_LETTERS: Mapping[str, int] = MappingProxyType(
    {letter: axis for letter, axis in AXIS_LETTERS.items() if letter not in INCREMENTAL_LETTERS}
)
LETTERS = frozenset("ABCFGIJKMNPRTUVWXYZ")
MAX_AXIS = 63
LARGEST = 1e9  # in any unit; keeps every square and product finite


class Word(msgspec.Struct, frozen=True, gc=False):
    """One word.

    Attributes:
        letter: upper case; ``[`` for an axis by its number.
        value: the number; NaN for a faulty one, in a line that is rejected anyway.
        index: of its token in the line; `ParsedLine.span` gives its columns.
        axis: 0-63 for axis words, else -1.
        text: the number as written.
        written: letter of the machine file's that is written instead of ``[n]``, such as E.
    """

    letter: str
    value: float
    index: int
    axis: int
    text: str
    written: str = ""

    @property
    def shown(self) -> str:
        """The word as in messages."""
        text = self.text if len(self.text) <= 24 else f"{self.text[:20]}…"
        return self.name + text

    @property
    def name(self) -> str:
        if self.letter != "[" or self.written:
            return self.written or self.letter
        return f"[{self.axis}]" if self.axis >= 0 else "[?]"
