"""Find lines and columns of the keys of a TOML text, which tomllib does not give."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import NamedTuple

Path = tuple[str | int, ...]

_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|' + r"'''.*?'{3,5}|" + r'"(?:\\.|[^"\\\n])*"|' + r"'[^'\n]*'"
    r"|\#[^\n]*|[ \t\r]+|\n|[\[\]{},=.]|[^\s\[\]{},=.\#\"']+",
    re.DOTALL,
)


class Position(NamedTuple):
    """A range in a text; line and columns (code points) from 1, end exclusive."""

    line: int
    column: int
    end_column: int


def find_positions(text: str) -> Mapping[Path, Position]:
    """Return the position of each key, table and array element, by paths such as ``("axis", 0, "type")``.

    Args:
        text: TOML that `tomllib` accepts.
    """
    return _Scanner(text).positions


def position_of(positions: Mapping[Path, Position], path: Path) -> Position | None:
    """Return the position of a path, or of the nearest enclosing table if the file does not have it."""
    for length in range(len(path), 0, -1):
        if path[:length] in positions:
            return positions[path[:length]]
    return None


class _Scanner:
    """Walks the tokens of a text once; recursion is as deep as the text's brackets."""

    def __init__(self, text: str) -> None:
        self.positions: dict[Path, Position] = {}
        self._tokens: list[tuple[str, Position]] = []
        line, line_start = 1, 0
        for match in _TOKEN.finditer(text.replace("\r\n", "\n")):
            token, column = match[0], match.start() - line_start + 1
            if token[0] not in " \t\r#":
                self._tokens.append((token, Position(line, column, column + len(token))))
            if "\n" in token:
                line += token.count("\n")
                line_start = match.start() + token.rindex("\n") + 1
        self._at = 0
        self._lengths: dict[Path, int] = {}
        self._read()

    def _peek(self, ahead: int = 0) -> str:
        place = self._at + ahead
        return self._tokens[place][0] if place < len(self._tokens) else ""

    def _skip_lines(self) -> None:
        while self._peek() == "\n":
            self._at += 1

    def _read(self) -> None:
        table: Path = ()
        while self._at < len(self._tokens):
            if self._peek() == "\n":
                self._at += 1
            elif self._peek() == "[":
                table = self._header()
            else:
                self._assignment(table)

    def _header(self) -> Path:
        array = self._peek(1) == "["
        self._at += 1 + array
        names, position = self._key()
        path: Path = ()
        for name in names:
            path += (name,)
            if path in self._lengths and path != names:
                path += (self._lengths[path] - 1,)
        if array:
            self._lengths[path] = self._lengths.get(path, 0) + 1
            self.positions.setdefault(path, position)
            path += (self._lengths[path] - 1,)
        self.positions[path] = position
        self._at += 1 + array
        return path

    def _key(self) -> tuple[tuple[str, ...], Position]:
        names: list[str] = []
        first = last = self._tokens[self._at][1]
        while self._peek() not in ("]", "=", "\n", ""):
            token, last = self._tokens[self._at]
            if token[0] in "\"'":
                names.append(next(iter(tomllib.loads(f"{token} = 0"))))
            elif token != ".":
                names.append(token)
            self._at += 1
        return tuple(names), Position(first.line, first.column, last.end_column)

    def _assignment(self, table: Path) -> None:
        names, position = self._key()
        path = table
        for name in names:
            path += (name,)
            self.positions.setdefault(path, position)
        self._at += 1
        self._value(path)

    def _value(self, path: Path) -> None:
        if self._peek() == "[":
            self._at += 1
            index = 0
            self._skip_lines()
            while self._peek() not in ("]", ""):
                self.positions[(*path, index)] = self._tokens[self._at][1]
                self._value((*path, index))
                index += 1
                self._skip_lines()
                if self._peek() == ",":
                    self._at += 1
                    self._skip_lines()
            self._at += 1
        elif self._peek() == "{":
            self._at += 1
            while self._peek() not in ("}", "\n", ""):
                self._assignment(path)
                if self._peek() == ",":
                    self._at += 1
            self._at += 1
        else:
            while self._peek() not in (",", "]", "}", "\n", ""):
                self._at += 1
