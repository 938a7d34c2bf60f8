"""Read many lines of the same words at once, their numbers as columns.

No line is looked at by itself: the letters of all lines are matched against one pattern, and the pieces of
text between the letters are the numbers.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.gcode.fast_path.code_text import AXIS_NAMES, CodeText, axis_of
from mcserver.gcode.text.words import LARGEST
from mcserver.motion.geometry.curves import Array

_AXES: Final = rb"[%b]+" % AXIS_NAMES
_FIRST: Final = re.compile(rb"G?(?:F?+(%b)|(%b)F)" % (_AXES, _AXES))
_LINEAR_CODES: Final = frozenset((b"1", b"01", b"001"))


class LineColumns(msgspec.Struct, frozen=True, eq=False):
    """Lines of at most G01, the same axis words in the same order, and F; blank lines between them.

    Attributes:
        taken: count of lines, blank ones included.
        lines: shape (n,), indices of those that are not blank, from 0.
        coded: True if the first of those has its G01.
        axes: K axis numbers, all different. values: K arrays of shape (n,), numbers as written.
        feeds: shape (n,), F as written, NaN where none is; None where no line has one.
    """

    taken: int
    lines: NDArray[np.int64]
    coded: bool
    axes: tuple[int, ...]
    values: tuple[Array, ...]
    feeds: Array | None

    def first(self, count: int) -> LineColumns:
        """Return the first ``count`` of `lines`, with the blank lines behind them."""
        if count >= len(self.lines):
            return self
        return LineColumns(
            int(self.lines[count]),
            self.lines[:count],
            self.coded,
            self.axes,
            tuple(column[:count] for column in self.values),
            None if self.feeds is None else self.feeds[:count],
        )


def read_columns(text: CodeText, least: int) -> LineColumns | None:
    """Read the longest prefix of lines with the same words; None below ``least`` lines.

    It ends before the first lexical error. The numbers are those of `float`, at most `LARGEST`; nothing else
    is checked.
    """
    letters = text.letters
    start = len(letters) - len(letters.lstrip(b"\n"))
    line = letters[start : letters.find(b"\n", start)]
    found = _FIRST.fullmatch(line)
    if found is None:
        return None
    names = found[1] or found[2]
    axes = tuple(axis for axis in map(axis_of, names) if axis is not None)
    if len(set(axes)) < len(axes):
        return None
    words = re.escape(names)
    prefix = re.compile(rb"(?:(?:G?+(?:%bF?+|F%b))?+\n)*+" % (words, words)).match(letters)
    assert prefix is not None  # the pattern matches the empty text too
    letters = prefix[0]
    taken = letters.count(b"\n")
    if taken < least:
        return None
    if len(letters) < len(text.letters):
        text = text.first(taken)
    columns = _TextColumns(letters, text.numbers(), start, line)
    values = tuple([columns.numbers(name) for name in names])
    columns.check(b"\n"[0], _is_blank)
    if b"G" in letters:
        columns.check(b"G"[0], _is_linear_code)
    feeds = columns.numbers(b"F"[0]) if b"F" in letters else None
    if columns.good < least:
        return None
    return columns.build(b"G" in line, axes, values, feeds)


def _is_blank(token: bytes) -> bool:
    return not token.strip()


def _is_linear_code(token: bytes) -> bool:
    return token.strip() in _LINEAR_CODES


def _is_number(token: bytes) -> bool:
    try:
        return abs(float(token)) <= LARGEST
    except ValueError:
        return False


class _TextColumns:
    """The pieces of text between letters, by the letter that they follow.

    ``good`` counts the lines, blank ones included, before the first that a check has refused.
    """

    def __init__(self, letters: bytes, tokens: list[bytes], start: int, line: bytes) -> None:
        self._letters = letters
        self._tokens = tokens
        self._width = len(line) + 1
        self.good = letters.count(b"\n")
        self._line = line + b"\n" if start == 0 and letters == (line + b"\n") * self.good else None
        self._kinds = np.frombuffer(letters, dtype=np.uint8)

    def _positions(self, letter: int) -> range | NDArray[np.int64]:
        """Return the positions of a letter among the letters."""
        if self._line is not None:
            return range(self._line.index(letter), len(self._letters), self._width)
        return np.flatnonzero(self._kinds == letter)

    def _after(self, positions: range | NDArray[np.int64]) -> list[bytes]:
        tokens = self._tokens
        if isinstance(positions, range):
            return tokens[positions.start + 1 :: positions.step]
        return [tokens[position] for position in (positions + 1).tolist()]

    def _refuse(self, position: int) -> None:
        self.good = min(self.good, self._letters.count(b"\n", 0, position))

    def check(self, letter: int, accepts: Callable[[bytes], bool]) -> None:
        """Check the pieces behind a letter; those behind a line feed stand before the first word."""
        positions = self._positions(letter)
        tokens = self._after(positions)
        if letter == b"\n"[0]:
            # the piece before the first line counts, the one behind the last does not
            tokens = self._tokens[:1] + tokens[:-1]
        if all(map(accepts, set(tokens))):
            return
        bad = next(index for index, token in enumerate(tokens) if not accepts(token))
        self._refuse(positions[bad])

    def numbers(self, letter: int) -> Array:
        """Convert the pieces behind a letter, up to the first that is not a number."""
        positions = self._positions(letter)
        tokens = self._after(positions)
        try:
            values = np.array(tokens, dtype=np.float64)
        except ValueError:
            pass
        else:
            if not len(values) or np.abs(values).max() <= LARGEST:
                return values
        bad = next(index for index, token in enumerate(tokens) if not _is_number(token))
        self._refuse(positions[bad])
        return np.array(tokens[:bad], dtype=np.float64)

    def build(
        self, coded: bool, axes: tuple[int, ...], values: tuple[Array, ...], feeds: Array | None
    ) -> LineColumns:
        """Build the columns of the lines before the first refused one."""
        if self._line is not None:
            lines = np.arange(self.good)
        else:
            ends = np.flatnonzero(self._kinds == b"\n"[0])
            lines = np.flatnonzero(np.diff(ends, prepend=-1) > 1)
            lines = lines[: np.searchsorted(lines, self.good)]
            if feeds is not None:
                positions = np.asarray(self._positions(b"F"[0]))[: len(feeds)]
                rows = np.searchsorted(lines, np.searchsorted(ends, positions))
                kept = rows < len(lines)
                spread = np.full(len(lines), np.nan)
                spread[rows[kept]] = feeds[kept]
                feeds = spread if kept.any() else None
        count = len(lines)
        return LineColumns(
            self.good,
            lines,
            coded,
            axes,
            tuple([column[:count] for column in values]),
            None if feeds is None else feeds[:count],
        )
