"""Many lines of the same words read at once: their numbers in columns.

Nothing here looks at one line by itself: the letters of all lines are held against one pattern, and the
pieces between the letters are the numbers. What the dialect's number syntax (D-01) refuses cannot get
through: only digits, signs, points and blanks stand between the letters, and of those `float` takes exactly
the numbers that `scanner.TOKEN` takes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.gcode.text.words import AXIS_LETTERS, LARGEST, MAX_AXIS
from mcserver.motion.geometry.curves import Array

_NUMERIC: Final = b"0123456789+-. \t"
_SEPARATOR: Final = b","
# every byte that is no part of a number ends one
_SPLIT: Final = bytes(byte if byte in _NUMERIC else _SEPARATOR[0] for byte in range(256))
_COMMENT: Final = re.compile(r"\([^()\n]*\)|;[^\n]*")
_INDEX: Final = re.compile(rb"\[[ \t]*[0-9]{1,3}[ \t]*\]")
# [n] becomes one byte that is not ASCII, so that it counts as a letter
_INDEXED: Final = 128
_AXES: Final = rb"[XYZABC\x80-\xbf]+"
_FIRST: Final = re.compile(rb"N?G?(?:F?+(%b)|(%b)F)" % (_AXES, _AXES))
_LINEAR_CODES: Final = frozenset((b"1", b"01", b"001"))
# different ways to write [n] in one reading; each costs a pass over the text
_MOST_INDICES: Final = 64


class AlikeLines(msgspec.Struct, frozen=True, eq=False):
    """Lines of at most N, G01, the same axis words in the same order, and F; blank lines between them.

    Attributes:
        taken: how many lines there are, blank ones too.
        lines: shape (n,), which of them are not blank, from 0.
        coded: whether the first of those has its G01.
        axes: K axis numbers, all different. values: K arrays of shape (n,), numbers as written.
        feeds: shape (n,), F as written, NaN where none is; None where no line has one.
    """

    taken: int
    lines: NDArray[np.int64]
    coded: bool
    axes: tuple[int, ...]
    values: tuple[Array, ...]
    feeds: Array | None

    def first(self, count: int) -> AlikeLines:
        """The first ``count`` of `lines`, as far as the next one that is not blank."""
        if count >= len(self.lines):
            return self
        return AlikeLines(
            int(self.lines[count]),
            self.lines[:count],
            self.coded,
            self.axes,
            tuple(column[:count] for column in self.values),
            None if self.feeds is None else self.feeds[:count],
        )


def read_alike(texts: Sequence[str], least: int) -> AlikeLines | None:
    """The longest beginning of ``texts`` that is alike and has no lexical fault; None below ``least`` lines.

    The numbers are those of `float`, none beyond `LARGEST`; more is not checked.
    """
    code = _code(texts)
    letters = code.translate(None, _NUMERIC)
    start = len(letters) - len(letters.lstrip(b"\n"))
    line = letters[start : letters.find(b"\n", start)]
    found = _FIRST.fullmatch(line)
    if found is None:
        return None
    names = found[1] or found[2]
    axes = tuple(byte - _INDEXED if byte >= _INDEXED else AXIS_LETTERS[chr(byte)] for byte in names)
    if len(set(axes)) < len(axes):
        return None
    words = re.escape(names)
    alike = re.compile(rb"(?:(?:N?+G?+(?:%bF?+|F%b))?+\n)*+" % (words, words)).match(letters)
    assert alike is not None  # it matches nothing at all as well
    letters = alike[0]
    taken = letters.count(b"\n")
    if taken < least:
        return None
    if taken < len(texts):
        code = b"\n".join(code.split(b"\n", taken)[:taken]) + b"\n"
    columns = _Columns(letters, code.translate(_SPLIT).split(_SEPARATOR), start, line)
    values = tuple([columns.numbers(name) for name in names])
    columns.check(b"\n"[0], _is_blank)
    if b"G" in letters:
        columns.check(b"G"[0], _is_linear_code)
    if b"N" in letters:
        columns.check(b"N"[0], _is_whole)
    feeds = columns.numbers(b"F"[0]) if b"F" in letters else None
    if columns.good < least:
        return None
    return columns.build(b"G" in line, axes, values, feeds)


def _code(texts: Sequence[str]) -> bytes:
    """The lines in capitals without comments, each with a line feed; what is not ASCII is a ``?``."""
    text = "\n".join(texts) + "\n"
    if text.count("\n") != len(texts):
        # a line feed inside a line is a fault of that line
        sound = next(index for index, line in enumerate(texts) if "\n" in line)
        text = "\n".join([*texts[:sound], "?", ""])
    if "(" in text or ";" in text:
        # a nested or unclosed parenthesis stays, and ends the beginning that is alike
        text = _COMMENT.sub(" ", text)
    code = text.encode("ascii", "replace").upper()
    if b"[" in code:
        written = set(_INDEX.findall(code))
        if len(written) <= _MOST_INDICES:
            for index in written:
                axis = int(index[1:-1])
                if axis <= MAX_AXIS:
                    code = code.replace(index, bytes((_INDEXED + axis,)))
    return code


def _is_blank(token: bytes) -> bool:
    return not token.strip()


def _is_linear_code(token: bytes) -> bool:
    return token.strip() in _LINEAR_CODES


def _is_whole(token: bytes) -> bool:
    return token.strip().isdigit()


def _is_number(token: bytes) -> bool:
    try:
        return abs(float(token)) <= LARGEST
    except ValueError:
        return False


class _Columns:
    """The pieces of text between letters, by the letter that they follow.

    ``good`` counts the lines, blank ones too, before the first that a check refused.
    """

    def __init__(self, letters: bytes, tokens: list[bytes], start: int, line: bytes) -> None:
        self._letters = letters
        self._tokens = tokens
        self._width = len(line) + 1
        self.good = letters.count(b"\n")
        self._line = line + b"\n" if start == 0 and letters == (line + b"\n") * self.good else None
        self._kinds = np.frombuffer(letters, dtype=np.uint8)

    def _places(self, letter: int) -> range | NDArray[np.int64]:
        """Where the letter stands among the letters."""
        if self._line is not None:
            return range(self._line.index(letter), len(self._letters), self._width)
        return np.flatnonzero(self._kinds == letter)

    def _after(self, places: range | NDArray[np.int64]) -> list[bytes]:
        tokens = self._tokens
        if isinstance(places, range):
            return tokens[places.start + 1 :: places.step]
        return [tokens[place] for place in (places + 1).tolist()]

    def _refuse(self, place: int) -> None:
        self.good = min(self.good, self._letters.count(b"\n", 0, place))

    def check(self, letter: int, accepts: Callable[[bytes], bool]) -> None:
        """Looks at the pieces behind a letter; behind a line feed is before the first word."""
        places = self._places(letter)
        tokens = self._after(places)
        if letter == b"\n"[0]:
            # the last one stands behind the end of the text, the first before it
            tokens = self._tokens[:1] + tokens[:-1]
        if all(map(accepts, set(tokens))):
            return
        bad = next(index for index, token in enumerate(tokens) if not accepts(token))
        self._refuse(places[bad])

    def numbers(self, letter: int) -> Array:
        """Numbers behind a letter, as far as they are numbers."""
        places = self._places(letter)
        tokens = self._after(places)
        try:
            values = np.array(tokens, dtype=np.float64)
        except ValueError:
            pass
        else:
            if not len(values) or np.abs(values).max() <= LARGEST:
                return values
        bad = next(index for index, token in enumerate(tokens) if not _is_number(token))
        self._refuse(places[bad])
        return np.array(tokens[:bad], dtype=np.float64)

    def build(
        self, coded: bool, axes: tuple[int, ...], values: tuple[Array, ...], feeds: Array | None
    ) -> AlikeLines:
        """The lines before the first that was refused."""
        if self._line is not None:
            lines = np.arange(self.good)
        else:
            ends = np.flatnonzero(self._kinds == b"\n"[0])
            lines = np.flatnonzero(np.diff(ends, prepend=-1) > 1)
            lines = lines[: np.searchsorted(lines, self.good)]
            if feeds is not None:
                places = np.asarray(self._places(b"F"[0]))[: len(feeds)]
                rows = np.searchsorted(lines, np.searchsorted(ends, places))
                kept = rows < len(lines)
                spread = np.full(len(lines), np.nan)
                spread[rows[kept]] = feeds[kept]
                feeds = spread if kept.any() else None
        count = len(lines)
        return AlikeLines(
            self.good,
            lines,
            coded,
            axes,
            tuple([column[:count] for column in values]),
            None if feeds is None else feeds[:count],
        )
