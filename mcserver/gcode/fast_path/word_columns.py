"""Read many lines of G01, G02 and G03 at once into a table of numbers.

The letters of a line are its pattern: which words it has and where. A program has few patterns, so each is
analysed once, and the numbers of all its lines are copied to their columns in one step.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.gcode.fast_path.code_text import INDEXED, CodeText, axis_of
from mcserver.gcode.fast_path.vocabulary import Vocabulary
from mcserver.gcode.text.words import LARGEST
from mcserver.motion.geometry.curves import Array

_LINE_FEED: Final = b"\n"[0]
# lines of F alone with a lower one, which may be a fault, are left to the block interpreter
_SLOW: Final = 10.0
# most patterns that are cached; a program has some tens
_MAX_PATTERNS: Final = 1024


class Shape(NamedTuple):
    """Geometry words: axis numbers, and 0 1 2 for I J K, in reading order, and whether there is an R.

    Lines of one shape make the same kind of curve over the same axes.
    """

    axes: tuple[int, ...]
    offsets: tuple[int, ...]
    radius: bool

    @property
    def curved(self) -> bool:
        """Return whether these are the words of an arc."""
        return self.radius or bool(self.offsets)


class Pattern(NamedTuple):
    """Indexes of a line's words among its letters; -1 for a missing one.

    Axis words and I J K in the order of `shape`; ``spindle`` is S, ``tool`` T. ``idle``: without effect.
    """

    shape: Shape
    axes: tuple[int, ...]
    offsets: tuple[int, ...]
    radius: int
    feed: int
    code: int
    spindle: int
    tool: int
    idle: str


class WordTable(msgspec.Struct, frozen=True, eq=False):
    """Lines of G01, G02 or G03, or without a code, and the numbers of their words as written.

    Attributes:
        taken: count of lines, including blank ones.
        lines: shape (n,), indexes of the lines that move something, from 0. begins: of the first line since
            the one before that is not blank: what those without motion say of code and F counts for it.
        shapes: the different shapes. shape: shape (n,), index of each line's shape.
        axes: K axis numbers, increasing. values: shape (n, K), NaN where an axis is not named.
        offsets: I J K, shape (n, 3), NaN where not written. radii: R, shape (n,), likewise.
        codes: 0 to 3 where a code is written, else -1, shape (n,).
        feeds: F, shape (n,), NaN where not written; None if no line has one. spindle: S, and tools: T,
            likewise.
        idle: by pattern, letters of words without effect. pattern: shape (n,), index of each line's pattern.
    """

    taken: int
    lines: NDArray[np.int64]
    begins: NDArray[np.int64]
    shapes: tuple[Shape, ...]
    shape: NDArray[np.intp]
    axes: tuple[int, ...]
    values: Array
    offsets: Array
    radii: Array
    codes: NDArray[np.int64]
    feeds: Array | None
    spindle: Array | None
    tools: Array | None
    idle: tuple[str, ...]
    pattern: NDArray[np.intp]

    def first(self, count: int) -> WordTable:
        """Return the first ``count`` of `lines`, with the blank lines after them."""
        if count >= len(self.lines):
            return self
        return WordTable(
            int(self.begins[count]),
            self.lines[:count],
            self.begins[:count],
            self.shapes,
            self.shape[:count],
            self.axes,
            self.values[:count],
            self.offsets[:count],
            self.radii[:count],
            self.codes[:count],
            None if self.feeds is None else self.feeds[:count],
            None if self.spindle is None else self.spindle[:count],
            None if self.tools is None else self.tools[:count],
            self.idle,
            self.pattern[:count],
        )

    def without_effect(self, number: int) -> dict[str, tuple[int, int]]:
        """Return for each letter without effect the first line that has it, and the count of these.

        Args:
            number: of the first line.
        """
        if not any(self.idle):
            return {}
        found: dict[str, tuple[int, int]] = {}
        for letter in dict.fromkeys("".join(self.idle)):
            having = np.flatnonzero(np.array([letter in each for each in self.idle])[self.pattern])
            if len(having):
                found[letter] = number + int(self.lines[having[0]]), len(having)
        return found


def pattern_of(letters: bytes, vocabulary: Vocabulary) -> Pattern | None:
    """Return the places of a line's words; None if they are not words of one of G01 to G03."""
    axes: dict[int, int] = {}
    offsets: dict[int, int] = {}
    idle = [ord(letter) for letter in vocabulary.idle]
    others = dict.fromkeys(
        (*b"RFG", *idle, *(b"S" if vocabulary.speed else b""), *(b"T" if vocabulary.tools else b"")), -1
    )
    for place, letter in enumerate(letters):
        axis = axis_of(letter, vocabulary.axes)
        if (letter == b"G"[0] and place > 0) or (letter >= INDEXED and not vocabulary.indexed):
            return None
        if axis is not None:
            words, name = axes, axis
        elif letter in b"IJK":
            words, name = offsets, letter - b"I"[0]
        elif letter in others and others[letter] < 0:
            others[letter] = place
            continue
        else:
            return None
        if name in words:
            return None
        words[name] = place
    radius, feed, code = (others[letter] for letter in b"RFG")
    spindle, tool = others.get(ord("S"), -1), others.get(ord("T"), -1)
    unused = "".join(chr(letter) for letter in idle if others[letter] >= 0)
    shape = Shape(tuple(axes), tuple(offsets), radius >= 0)
    # a code or F without motion
    still = not (axes or offsets) and max(radius, spindle, tool) < 0 and not unused
    if not (axes or (code >= 0 and offsets) or still) or (radius >= 0 and offsets):
        return None
    places = tuple(axes.values()), tuple(offsets.values())
    return Pattern(shape, *places, radius, feed, code, spindle, tool, unused)


class WordReader:
    """Reads words into columns, and caches patterns."""

    __slots__ = ("_patterns", "_vocabulary")

    def __init__(self, vocabulary: Vocabulary) -> None:
        self._vocabulary = vocabulary
        self._patterns: dict[bytes, Pattern | None] = {}

    def read(self, text: CodeText, least: int) -> WordTable | None:
        """Read the longest prefix of lines in the vocabulary; None if shorter than ``least``, or blank.

        It ends before the first lexical error. Numbers are as of `float`, at most `LARGEST`; nothing else is
        checked.
        """
        letters = text.letters.split(b"\n")
        letters.pop()
        known = self._known(set(letters))
        if None in known.values():
            taken = next(index for index, each in enumerate(letters) if each and known[each] is None)
            if taken < least:
                return None
            text = text.first(taken)
            del letters[taken:]
        kinds = np.frombuffer(text.letters, dtype=np.uint8)
        # a 0 before the text ahead of a line's first word: a number only if that text is blank
        tokens = CodeText(b"0 " + text.code.replace(b"\n", b"\n0 "), b"").numbers()
        values = _numbers(tokens)
        taken = int(np.count_nonzero(kinds[: _sound(kinds, tokens, values, self._vocabulary)] == _LINE_FEED))
        del letters[taken:]
        if taken < least or not any(letters):
            return None
        least = self._vocabulary.codes[b"0"]
        return _table(letters, known, kinds, values, least)

    def _known(self, letters: set[bytes]) -> dict[bytes, Pattern | None]:
        """Return the patterns of lines, without blank lines."""
        if len(self._patterns) > _MAX_PATTERNS:
            self._patterns.clear()
        for each in letters:
            if each not in self._patterns:
                self._patterns[each] = pattern_of(each, self._vocabulary)
        return {each: self._patterns[each] for each in letters if each}


def _numbers(tokens: list[bytes]) -> Array:
    """Convert tokens up to the first that is not a number."""
    try:
        return np.array(tokens, dtype=np.float64)
    except ValueError:
        sound = next(index for index, token in enumerate(tokens) if not _is_number(token))
        return np.array(tokens[:sound], dtype=np.float64)


def _is_number(token: bytes) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return True


def _sound(kinds: NDArray[np.uint8], tokens: list[bytes], values: Array, vocabulary: Vocabulary) -> int:
    """Return how many tokens are valid after their letters: a known motion code after G, no huge number.

    Args:
        kinds: letters; the one before token i has index i - 1. values: of the tokens before the first that is
            not a number.
    """
    sound = len(values)
    huge = np.abs(values) > LARGEST
    if huge.any():
        sound = int(huge.argmax())
    places = (np.flatnonzero(kinds[: max(sound - 1, 0)] == b"G"[0]) + 1).tolist()
    refused = {
        token for token in set(map(tokens.__getitem__, places)) if token.strip() not in vocabulary.codes
    }
    return next(place for place in places if tokens[place] in refused) if refused else sound


def _table(
    letters: list[bytes],
    known: dict[bytes, Pattern | None],
    kinds: NDArray[np.uint8],
    values: Array,
    least: int,
) -> WordTable:
    """Copy the numbers of lines to their columns; ``least``: the code that G0 stands for."""
    # usually all lines of a window of a long file have one pattern
    alike = letters.count(letters[0]) == len(letters)
    distinct = letters[:1] if alike else dict.fromkeys(letters)
    patterns = {each: pattern for each in distinct if (pattern := known.get(each)) is not None}
    shapes = tuple(dict.fromkeys(pattern.shape for pattern in patterns.values()))
    axes = tuple(sorted({axis for shape in shapes for axis in shape.axes}))
    # index of each line's pattern; blank lines have the last
    place = {each: index for index, each in enumerate(patterns)}
    blank = len(place)
    which = np.zeros(len(letters), np.intp)
    if not alike:
        which[:] = [place.get(each, blank) for each in letters]
    lines = np.flatnonzero(which < blank)
    ends = np.flatnonzero(kinds == _LINE_FEED)[: len(letters)]
    # index of the number of each line's first word
    first = np.concatenate(([1], ends[:-1] + 2))[lines]
    which = which[lines]
    count = len(lines)
    shape = np.empty(count, np.intp)
    codes = np.full(count, -1.0)
    columns, offsets = np.full((count, len(axes)), np.nan), np.full((count, 3), np.nan)
    radii, feeds = np.full(count, np.nan), np.full(count, np.nan)
    spindle, tools = np.full(count, np.nan), np.full(count, np.nan)
    fed = spun = chosen = False
    for index, pattern in enumerate(patterns.values()):
        rows = np.flatnonzero(which == index)
        at = first[rows]
        shape[rows] = shapes.index(pattern.shape)
        for axis, word in zip(pattern.shape.axes, pattern.axes, strict=True):
            columns[rows, axes.index(axis)] = values[at + word]
        for offset, word in zip(pattern.shape.offsets, pattern.offsets, strict=True):
            offsets[rows, offset] = values[at + word]
        for column, word in (
            (radii, pattern.radius),
            (feeds, pattern.feed),
            (spindle, pattern.spindle),
            (tools, pattern.tool),
        ):
            if word >= 0:
                column[rows] = values[at + word]
        if pattern.code >= 0:
            codes[rows] = np.maximum(values[at + pattern.code], least)
        fed = fed or pattern.feed >= 0
        spun = spun or pattern.spindle >= 0
        chosen = chosen or pattern.tool >= 0
    taken, begins = len(letters), lines
    still = np.array([not (each.axes or each.offsets or each.radius) for each in shapes])[shape]
    if still.any():
        taken, kept, begins = _with_next(still, lines, codes, feeds, taken)
        lines, which, shape, codes, feeds = (each[kept] for each in (lines, which, shape, codes, feeds))
        columns, offsets, radii = (each[kept] for each in (columns, offsets, radii))
        spindle, tools = spindle[kept], tools[kept]
    return WordTable(
        taken=taken,
        lines=lines,
        begins=begins,
        shapes=shapes,
        shape=shape,
        axes=axes,
        values=columns,
        offsets=offsets,
        radii=radii,
        codes=codes.astype(np.int64),
        feeds=feeds if fed else None,
        spindle=spindle if spun else None,
        tools=tools if chosen else None,
        idle=tuple(pattern.idle for pattern in patterns.values()),
        pattern=which,
    )


def _with_next(
    still: NDArray[np.bool_], lines: NDArray[np.int64], codes: Array, feeds: Array, taken: int
) -> tuple[int, NDArray[np.intp], NDArray[np.int64]]:
    """Give code and F of lines without motion to the next line with motion that has none, in place.

    Returns:
        Count of lines to the last with motion, or to a slow F; which have motion; their `WordTable.begins`.
    """
    kept: list[int] = []
    begins: list[int] = []
    code, feed, begin = -1.0, math.nan, -1
    end = taken
    rows = zip(still.tolist(), lines.tolist(), codes.tolist(), feeds.tolist(), strict=True)
    for row, (rests, line, own_code, own_feed) in enumerate(rows):
        if rests and own_feed < _SLOW:
            end = line
            break
        begin = line if begin < 0 else begin
        code = own_code if own_code >= 0.0 else code
        feed = feed if math.isnan(own_feed) else own_feed
        if not rests:
            kept.append(row)
            begins.append(begin)
            codes[row], feeds[row] = code, feed
            code, feed, begin = -1.0, math.nan, -1
    return (end if begin < 0 else begin), np.array(kept, np.intp), np.array(begins, np.int64)
