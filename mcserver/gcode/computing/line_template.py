"""Compile a line that computes, and evaluate it to a plain line (D-80, D-81, D-92)."""

from __future__ import annotations

import contextlib
import math
import re
from bisect import bisect_left, bisect_right
from typing import NamedTuple

import numpy as np

from mcserver.gcode.computing.expressions import (
    NGC,
    NULL,
    TOLERANCE,
    ComputingError,
    Language,
    Parameter,
    Value,
    Values,
    read_operation,
    read_parameter,
    read_value,
    skip,
)
from mcserver.gcode.line_faults import Span

_LITERAL = re.compile(r"[A-Z@^][ \t]*[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)", re.IGNORECASE)
_LETTER = re.compile(r"[A-Z@^]", re.IGNORECASE)
_AXIS = re.compile(r"\[[ \t]*[0-9]{1,2}[ \t]*\]")
_COMMENT = re.compile(r"\([^()]*\)?|;.*")
_SHOWING = re.compile(r"\([ \t]*(?:DEBUG|PRINT|LOG)[ \t]*,", re.IGNORECASE)
_SHOWN = re.compile(r"#(?:<[^<>]*>|[0-9]+)|%(?:d|l?f)", re.IGNORECASE)
_MACRO = re.compile(r"(?:IF|WHILE)[ \t]*\[|GOTO|DO[ \t]*[0-9]|END[ \t]*[0-9]", re.IGNORECASE)
# letters whose numbers are whole; not D, which may be a diameter
_WHOLE = frozenset("HLMNT")


class Piece(NamedTuple):
    """A computed value in a line, and its columns.

    Attributes:
        letter: of its word; empty in a comment. decimals: of a value in a comment.
        name: text before the value, omitted with it if it is `NULL`.
    """

    value: Value
    span: Span
    letter: str
    decimals: int = 6
    name: str = ""

    def text(self, values: Values) -> str | None:
        """Return the value as text of a plain line; None: a check could not compute it.

        Raises:
            ComputingError: MC116 a number is not whole that has to be.
        """
        value = self.value(values)
        if math.isnan(value):
            return None
        if value is NULL and self.name:
            return ""
        if not self.letter:
            return f"{value:.{self.decimals}f}"
        whole = round(value)
        if self.letter in _WHOLE and abs(value - whole) >= TOLERANCE:
            raise ComputingError("MC116", f"{self.letter}{value:g} is not a whole number", self.span)
        if self.letter in _WHOLE or abs(value - whole) < 1e-12:
            return f"{self.name}{whole} "
        return f"{self.name}{np.format_float_positional(value, trim='-')} "


class Columns:
    """Map columns of a plain line to columns of the line it was computed from."""

    def __init__(self) -> None:
        # pairs of indexes: where a part begins in the plain line and in the original one
        self._plain = [0]
        self._written = [0]
        self._length = 0

    def copy(self, start: int, end: int) -> None:
        """Note that characters were copied."""
        self._mark(start)
        self._length += end - start
        self._mark(end)

    def compute(self, span: Span, length: int) -> None:
        """Note that ``length`` characters of a value replace those in ``span``."""
        self._mark(span[0] - 1)
        self._length += length
        self._mark(span[1] - 1)

    def _mark(self, written: int) -> None:
        self._plain.append(self._length)
        self._written.append(written)

    def span(self, span: Span) -> Span:
        """Return the columns in the original line for columns in the plain one."""
        first = self._at(span[0] - 1, bisect_right(self._plain, span[0] - 1) - 1, begins=True)
        last = self._at(span[1] - 1, bisect_left(self._plain, span[1] - 1), begins=False)
        return first + 1, max(last, first + 1) + 1

    def _at(self, index: int, part: int, *, begins: bool) -> int:
        """Return the index in the original line; within a value its first or its last."""
        if begins:
            after = min(part + 1, len(self._plain) - 1)
            same = self._plain[after] - self._plain[part] == self._written[after] - self._written[part]
            return self._written[part] + (index - self._plain[part] if same else 0)
        part = min(part, len(self._plain) - 1)
        before = max(part - 1, 0)
        same = self._plain[part] - self._plain[before] == self._written[part] - self._written[before]
        return self._written[part] - (self._plain[part] - index if same else 0)


class Setting(NamedTuple):
    """A parameter and its value; ``number`` is 0 for a named or an unknown one."""

    parameter: Parameter
    number: int
    value: float


class Plain(NamedTuple):
    """A plain line, and the parameters that it sets once it has been read.

    Attributes:
        text: None if a check could not compute one of its values.
        settings: parameters to set.
    """

    text: str | None
    columns: Columns
    settings: list[Setting]


class LineTemplate:
    """A line, compiled.

    Raises:
        ComputingError: MC140, MC160.
    """

    __slots__ = ("_copied", "_language", "_parts", "_settings", "_text")

    def __init__(self, text: str, language: Language = NGC) -> None:
        self._text = text
        self._language = language
        # a range of indexes of the text, or a value
        self._parts: list[tuple[int, int] | Piece] = []
        self._settings: list[tuple[Parameter, Value]] = []
        self._copied = 0
        at = 0
        while at < len(text):
            at = self._read_on(at)
        self._put(None, at, at)

    def _put(self, piece: Piece | None, start: int, end: int) -> None:
        """Add a value, or the text itself, for the text between two indexes."""
        if self._copied < start:
            self._parts.append((self._copied, start))
        if piece is not None:
            self._parts.append(piece)
        self._copied = end

    def _read_on(self, at: int) -> int:
        """Read the token at an index, and return the index after it."""
        text = self._text
        literal = _LITERAL.match(text, at)
        if literal is not None:
            return literal.end()
        comment = _COMMENT.match(text, at)
        if comment is not None:
            if _SHOWING.match(comment[0]):
                self._read_shown(comment)
            return comment.end()
        if text[at] == "#":
            return self._read_setting(at)
        axis = _AXIS.match(text, at)
        if axis is None and not _LETTER.match(text, at):
            return at + 1
        macro = _MACRO.match(text, at)
        if macro is not None:
            shown, span = macro[0].rstrip("[").strip(), (at + 1, macro.end() + 1)
            if self._language.null:
                hint = "give it a line of its own"
                raise ComputingError("MC181", f"{shown} begins no line here", span, hint)
            raise ComputingError(
                "MC140",
                f"{shown} is Fanuc's macro language, which is not read here",
                span,
                "LinuxCNC's begins with its O-word: o100 if [...]; Fanuc's is read with "
                '[dialect] macros = "fanuc" in the machine file',
            )
        start = skip(text, at + 1 if axis is None else axis.end())
        value, end = read_value(text, start, 0, self._language)
        name = text[at:start] if self._language.null else ""
        start -= len(name)
        self._put(Piece(value, (start + 1, end + 1), text[at].upper(), name=name), start, end)
        return end

    def _read_setting(self, at: int) -> int:
        text = self._text
        parameter, end = read_parameter(text, at, 0, self._language)
        equals = skip(text, end)
        if text[equals : equals + 1] != "=":
            raise ComputingError(
                "MC160",
                "a parameter stands for no word",
                parameter.span,
                "write a letter before it, or = and a value behind it",
            )
        read = read_operation if self._language.null else read_value
        value, end = read(text, equals + 1, 0, self._language)
        self._settings.append((parameter, value))
        self._put(None, at, end)
        return end

    def _read_shown(self, comment: re.Match[str]) -> None:
        """Read the parameters in a comment that prints them."""
        decimals = 6
        for found in _SHOWN.finditer(self._text, comment.start(), comment.end()):
            end, piece = found.end(), None
            if found[0][0] == "%":
                decimals = {"%d": 0, "%f": 4}.get(found[0].lower(), 6)
            else:
                parameter, end = read_parameter(self._text, found.start(), 0, self._language)
                piece = Piece(parameter, (found.start() + 1, end + 1), "", decimals)
            self._put(piece, found.start(), end)

    def evaluate(self, values: Values) -> Plain:
        """Compute the line; parameters that it sets keep their old values until it has been interpreted.

        Raises:
            ComputingError: MC116, MC162, MC163, MC168. Unsettled: a value is not known yet.
        """
        columns, pieces, known = Columns(), [], True
        for part in self._parts:
            if isinstance(part, Piece):
                text = part.text(values)
                known &= text is not None
                pieces.append(text or "")
                columns.compute(part.span, len(text or ""))
            else:
                pieces.append(self._text[part[0] : part[1]])
                columns.copy(*part)
        settings = [
            Setting(parameter, 0 if parameter.name else parameter.index(values), value(values))
            for parameter, value in self._settings
        ]
        return Plain("".join(pieces) if known else None, columns, settings)

    def settings_unknown(self, values: Values) -> list[Setting]:
        """Return settings of NaN for a line whose values cannot be computed; for checks."""
        found = []
        for parameter, _ in self._settings:
            with contextlib.suppress(ComputingError):
                found.append(Setting(parameter, 0 if parameter.name else parameter.index(values), math.nan))
        return found
