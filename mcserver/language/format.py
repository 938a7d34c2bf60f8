"""Format a program: one blank between words, capitals, two-digit codes, plain numbers. No meaning changes."""

from __future__ import annotations

import re

from mcserver.gcode.line_faults import FaultList
from mcserver.gcode.text.parser import scan_line
from mcserver.gcode.text.scanner import TOKEN, blank_comments
from mcserver.language.fix import lines_with_ends

_COMMENT = re.compile(r"\([^)]*\)|;.*", re.DOTALL)
_NUMBER = re.compile(r"([-+]?)([0-9]*)(?:\.([0-9]*))?\Z")
_LEAST_GAP = 2  # blanks before a comment that ends a line


def format_program(text: str) -> str:
    """Format every line that has no fault of text or grammar; the last line gets an end."""
    # a text that was cut between the two characters of its last end of line
    lines = [(format_line(line), end) for line, end in lines_with_ends(text + "\n" * text.endswith("\r"))]
    if lines and not lines[-1][1]:
        lines[-1] = (lines[-1][0], "\n")
    return "".join(line + end for line, end in lines)


def format_line(line: str) -> str:
    """Format one line; a faulty one, and one that begins with ``%``, keep their text.

    A comment behind the code stays in its column if the code leaves room, so that columns of comments stay.
    """
    if scan_line(line, 2).faults or line.lstrip(" \t").startswith("%"):
        return line
    code = blank_comments(line, FaultList(2))
    pieces = [(found.start(), found[0]) for found in _COMMENT.finditer(line)]
    pieces += [(found.start(), _format_token(*found.groups(""))) for found in TOKEN.finditer(code.upper())]
    written = ""
    for column, piece in sorted(pieces):
        if piece == ",":
            written += piece
        elif piece.startswith(";"):
            gap = max(_LEAST_GAP, column - len(written)) if written else 0
            written += " " * gap + piece.rstrip()
        else:
            written += (" " if written else "") + piece
    return written if same_code(line, written) else line


def _format_token(name: str, number: str, other: str) -> str:
    """Write a word or a comma."""
    if other:
        return other
    if name in ("G", "M"):
        return f"{name}{(number.lstrip('0') or '0').zfill(2)}"
    if name == "N":
        return name + number
    if name.startswith("["):
        name = f"[{int(name[1:-1])}]"
    return name + format_number(number)


def format_number(text: str) -> str:
    """Write a number without a plus sign, needless zeros in front, or a point at its end; decimals stay."""
    found = _NUMBER.match(text)
    assert found is not None
    sign, whole, decimals = found.groups("")
    return ("-" if sign == "-" else "") + (whole.lstrip("0") or "0") + (f".{decimals}" if decimals else "")


def same_code(first: str, second: str) -> bool:
    """Return True if two lines have the same words, to the last bit of their numbers."""
    return _words(first) == _words(second)


def _words(line: str) -> list[tuple[str, str]]:
    tokens = TOKEN.findall(blank_comments(line, FaultList(2)).upper())
    return [
        (re.sub(r"[\[\] \t]", "", name).lstrip("0") or name[:1], other or float(number).hex())
        for name, number, other in tokens
    ]
