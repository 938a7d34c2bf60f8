"""Read the simplest blocks, which are most lines of most programs, straight from their tokens."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

import msgspec

from mcserver.gcode.text.scanner import Token
from mcserver.gcode.text.words import AXIS_LETTERS, LARGEST, MAX_AXIS

_CODES: Final = MappingProxyType({zeros + str(code): code for code in (1, 2, 3) for zeros in ("", "0", "00")})
_AXES: Final = MappingProxyType({letter: AXIS_LETTERS[letter] for letter in "XYZABC"})
_OFFSETS: Final = MappingProxyType({"I": 0, "J": 1, "K": 2})


class SimpleBlock(msgspec.Struct, frozen=True, gc=False):
    """A line of at most N, one of G01-G03, different axes, I J K or R, and F.

    Attributes:
        code: 1 to 3 if written, else None.
        axes, values: axis numbers and numbers as written, in reading order.
        feed: F, above zero, or None.
        offsets: (0 1 2, number) of I J K. radius: R. Both empty for a straight move.
    """

    code: int | None
    axes: tuple[int, ...]
    values: tuple[float, ...]
    feed: float | None
    offsets: tuple[tuple[int, float], ...] = ()
    radius: float | None = None

    @property
    def curved(self) -> bool:
        """Return True if its words are those of an arc."""
        return self.radius is not None or bool(self.offsets)


def read_simple_block(tokens: list[Token]) -> SimpleBlock | None:
    """Return the simple block, or None for a line with anything else in it or with a possible fault."""
    if not tokens:
        return None
    start = 0
    name, text, _ = tokens[0]
    if name == "N":
        if not text.isdigit() or len(tokens) == 1:
            return None
        start = 1
        name, text, _ = tokens[1]
    code: int | None = None
    if name == "G":
        code = _CODES.get(text)
        if code is None:
            return None
        start += 1
    axes: list[int] = []
    values: list[float] = []
    offsets: dict[int, float] = {}
    radius: float | None = None
    feed: float | None = None
    for name, text, _ in tokens[start:]:
        if not name:
            return None
        value = float(text)
        if not -LARGEST <= value <= LARGEST:
            return None
        axis = _AXES.get(name)
        if axis is not None:
            axes.append(axis)
            values.append(value)
        elif name == "F":
            if feed is not None or value <= 0.0:
                return None
            feed = value
        elif name in _OFFSETS:
            if _OFFSETS[name] in offsets:
                return None
            offsets[_OFFSETS[name]] = value
        elif name == "R":
            if radius is not None:
                return None
            radius = value
        elif name[0] == "[":
            axis = int(name[1:-1])
            if axis > MAX_AXIS:
                return None
            axes.append(axis)
            values.append(value)
        else:
            return None
    if len(set(axes)) != len(axes) or not (axes or (code is not None and offsets)):
        return None
    curved = radius is not None or bool(offsets)
    if curved and (code == 1 or (radius is not None and offsets)):
        return None
    return SimpleBlock(code, tuple(axes), tuple(values), feed, tuple(offsets.items()), radius)
