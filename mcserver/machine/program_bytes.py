"""Decode a program's file, also as older CAM systems write it."""

from __future__ import annotations

import codecs


class NoText(ValueError):
    """A line is not text.

    Attributes:
        line, column: of its first byte 0, from 1.
    """

    def __init__(self, line: int, column: int) -> None:
        super().__init__(f"line {line} has a byte 0")
        self.line = line
        self.column = column


def text_of_bytes(content: bytes) -> str:
    """Return a file's text, without a byte order mark (`text_of_lines`). Raises `NoText`."""
    return text_of_lines(content.removeprefix(codecs.BOM_UTF8))


def text_of_lines(content: bytes, *, strict: bool = True) -> str:
    """Decode complete lines one by one, so that blocks of a file give the same text as the whole (D-01).

    A line that is not UTF-8 is Windows' Latin-1, in which older CAM systems write comments; code is ASCII in
    both.

    Raises:
        NoText: if strict, for a line that is not UTF-8 and has a byte 0, which text never has.
    """
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        lines = enumerate(content.split(b"\n"), start=1)
        return "\n".join(_text_of_line(line, number, strict) for number, line in lines)


def _text_of_line(line: bytes, number: int, strict: bool) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        if strict and b"\0" in line:
            raise NoText(number, line.index(0) + 1) from None
        return line.decode("cp1252", "replace")
