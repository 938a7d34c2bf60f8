"""Prepare lines for reading in columns: upper case, no comments, no line numbers, ``[n]`` as one byte.

Here a *letter* is every byte that cannot be part of a number, including the line feed at a line's end.
Between letters are only digits, signs, points and blanks, of which `float` accepts exactly the numbers that
`mcserver.gcode.text.scanner.TOKEN` accepts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from mcserver.gcode.notices import speaks
from mcserver.gcode.text.words import MAX_AXIS

_NUMERIC: Final = b"0123456789+-. \t"
_SEPARATOR: Final = b","
# replaces every letter by the separator
_SPLIT: Final = bytes(byte if byte in _NUMERIC else _SEPARATOR[0] for byte in range(256))
_COMMENT: Final = re.compile(r"\([^()\n]*\)|;[^\n]*")
# a line number: whole, and before a word
_NUMBER: Final = re.compile(rb"(?m)^[ \t]*+N[ \t]*+[0-9]++[ \t]*+(?=[A-Z\x80-\xbf])")
_INDEX: Final = re.compile(rb"\[[ \t]*[0-9]{1,3}[ \t]*\]")
# [n] becomes one byte beyond ASCII, which counts as a letter
INDEXED: Final = 128
# different spellings of [n] in one window; each costs a pass over the text
_MAX_SPELLINGS: Final = 64


class CodeText(NamedTuple):
    """Lines of code as bytes, each with a line feed, and their letters alone."""

    code: bytes
    letters: bytes

    @classmethod
    def of(cls, texts: Sequence[str]) -> CodeText:
        """Join lines; characters beyond ASCII become ``?``."""
        text = "\n".join(texts) + "\n"
        if text.count("\n") != len(texts):
            # a line feed within a line is a fault of that line
            sound = next(index for index, line in enumerate(texts) if "\n" in line)
            text = "\n".join([*texts[:sound], "?", ""])
        if "(" in text or ";" in text:
            said = speaks(text) if "(" in text else None
            if said is not None:
                # lines with a comment for an operator or a body are left to the block interpreter
                text = text[: text.rfind("\n", 0, said.start()) + 1] + "?\n"
            # a nested or unclosed parenthesis stays, and so ends the batch
            text = _COMMENT.sub(" ", text)
        code = text.encode("ascii", "replace").upper()
        if b"[" in code:
            written = set(_INDEX.findall(code))
            if len(written) <= _MAX_SPELLINGS:
                for index in written:
                    axis = int(index[1:-1])
                    if axis <= MAX_AXIS:
                        code = code.replace(index, bytes((INDEXED + axis,)))
        if b"N" in code:
            code = _NUMBER.sub(b"", code)
        return cls(code, code.translate(None, _NUMERIC))

    def first(self, count: int) -> CodeText:
        """Return the first ``count`` lines."""
        code = b"".join([line + b"\n" for line in self.code.split(b"\n", count)[:count]])
        return CodeText(code, code.translate(None, _NUMERIC))

    def numbers(self) -> list[bytes]:
        """Return the text between the letters: item i + 1 follows letter i."""
        return self.code.translate(_SPLIT).split(_SEPARATOR)


def axis_of(letter: int, letters: Mapping[str, int]) -> int | None:
    """Return the axis that a letter names, or None."""
    return letter - INDEXED if letter >= INDEXED else letters.get(chr(letter))
