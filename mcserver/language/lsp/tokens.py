"""The tokens of a line as an editor colours them: codes, words, parameters, comments."""

from __future__ import annotations

import re
from collections.abc import Iterator

import msgspec

TOKEN_TYPES = ("comment", "keyword", "parameter", "number", "variable", "function")
_TOKEN = re.compile(
    r"(?P<comment>\([^)]*\)?|;.*)"
    r"|(?P<function>O[ \t]*(?:<[^>]*>|[0-9]+)[ \t]*[A-Z]+)"
    r"|(?P<variable>#+[ \t]*(?:<[^>]*>|[0-9]+))"
    r"|(?P<keyword>[GM][ \t]*[0-9]+(?:\.[0-9]+)?)"
    r"|(?P<parameter>[A-Z]|\[[ \t]*[0-9]+[ \t]*\])"
    r"|(?P<number>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))",
    re.IGNORECASE,
)


class Token(msgspec.Struct, frozen=True):
    """One token: code points from 0, end exclusive; ``kind`` is one of `TOKEN_TYPES`."""

    kind: str
    start: int
    end: int


def tokens_of(line: str) -> Iterator[Token]:
    """Return the tokens of a line in order; a line of % has a comment alone."""
    if line.lstrip().startswith("%"):
        yield Token("comment", 0, len(line.rstrip()))
        return
    for found in _TOKEN.finditer(line):
        kind = found.lastgroup
        if kind is not None and found.start() < found.end():
            yield Token(kind, found.start(), found.end())
