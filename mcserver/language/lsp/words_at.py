"""Find the words of a line, for completion and hover: code points from 0, end exclusive."""

from __future__ import annotations

import re

import msgspec

_WORD = re.compile(r"(?P<name>[A-Za-z]|\[[ \t]*[0-9]*[ \t]*\]?)[ \t]*(?P<number>[-+0-9.]*)")
_COMMENT = re.compile(r"\([^)]*\)?|;.*", re.DOTALL)


class WordAt(msgspec.Struct, frozen=True):
    """A word as far as it is written.

    Attributes:
        name: an upper-case letter, or ``[n]``.
        number: as written, perhaps empty.
        start, end: code points from 0, end exclusive.
    """

    name: str
    number: str
    start: int
    end: int

    @property
    def is_code(self) -> bool:
        """Return True for G and M."""
        return self.name in ("G", "M")


def in_comment(line: str, position: int) -> bool:
    """Return True if a position lies within a comment."""
    return any(found.start() < position <= _inner_end(found) for found in _COMMENT.finditer(line))


def _inner_end(found: re.Match[str]) -> int:
    return found.end() - 1 if found[0].startswith("(") and found[0].endswith(")") else found.end()


def words_of(line: str) -> list[WordAt]:
    """Return the words of a line, without those in comments."""
    code = _COMMENT.sub(lambda found: " " * len(found[0]), line)
    return [
        WordAt(_name(found["name"]), found["number"], found.start(), found.end())
        for found in _WORD.finditer(code)
    ]


def _name(written: str) -> str:
    return re.sub(r"[ \t]", "", written) if written.startswith("[") else written.upper()


def word_at(line: str, position: int) -> WordAt | None:
    """Return the word that a position touches."""
    return next((word for word in words_of(line) if word.start <= position <= word.end), None)
