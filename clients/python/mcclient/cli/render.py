# mcserver/gcode/render.py, by python -m mcserver.contract.sdk clients: change it there
"""Render a diagnostic as a compiler does: the line, carets under the columns, the remedy."""

from __future__ import annotations

import unicodedata

from mcclient.types import Diagnostic

TAB = 4  # columns that a tab is shown as
WINDOW = 100  # most columns shown of a line; longer lines are cut around the mark
ELLIPSIS = "…"


def render(diagnostic: Diagnostic, text: str | None, path: str, title: str = "") -> list[str]:
    """Render a diagnostic as lines, without colour.

    Args:
        text: of its line; None: unknown, no excerpt.
        path: name of the program. title: of the diagnostic's code; the message is then written at the mark.
    """
    head = f"{diagnostic.severity}[{diagnostic.code}]: {title or diagnostic.message}"
    lines = [head]
    label = diagnostic.message if title else ""
    if diagnostic.line > 0:
        place = f":{diagnostic.column}" if diagnostic.column > 0 else ""
        lines.append(f" --> {path}:{diagnostic.line}{place}")
    else:
        lines.append(f" --> {path}")
    width = 1
    if text is not None and diagnostic.line > 0:
        margin = str(diagnostic.line)
        width = len(margin)
        shown, before, marked = excerpt(text, diagnostic.column, diagnostic.end_column)
        lines.append(f"{margin} | {shown}".rstrip())
        if diagnostic.column > 0:
            lines.append(f"{' ' * width} | {' ' * before}{'^' * marked} {label}".rstrip())
            label = ""
    if label:
        lines.append(f"{' ' * width} = {label}")
    if diagnostic.hint:
        lines.append(f"{' ' * width} = help: {diagnostic.hint}")
    return lines


def excerpt(line: str, column: int, end_column: int) -> tuple[str, int, int]:
    """Cut a line for display: text, terminal columns before the mark, and the mark's width.

    Tabs become blanks, control characters their pictures; wide characters count as two columns, combining
    ones as zero. A line longer than `WINDOW` is cut around the marked columns.

    Args:
        column, end_column: code points from 1, end exclusive; 0: no column is marked.
    """
    first = max(0, min(column - 1, len(line)))
    last = max(first, min(end_column - 1, len(line)))
    start, stop = _window(len(line), first, last)
    text = "".join(_shown(character) for character in line[start:stop])
    lead = ELLIPSIS if start > 0 else ""
    tail = ELLIPSIS if stop < len(line) else ""
    before = _width(lead) + sum(_width(_shown(character)) for character in line[start:first])
    marked = sum(_width(_shown(character)) for character in line[first : min(last, stop)])
    return lead + text + tail, before, max(1, marked)


def _window(length: int, first: int, last: int) -> tuple[int, int]:
    if length <= WINDOW:
        return 0, length
    marked = min(last - first, WINDOW // 2)
    start = max(0, min(first - (WINDOW - marked) // 2, length - WINDOW))
    return start, min(length, start + WINDOW)


def _shown(character: str) -> str:
    if character == "\t":
        return " " * TAB
    code = ord(character)
    if code < 0x20:
        return chr(0x2400 + code)
    if code == 0x7F:
        return "\u2421"
    if unicodedata.category(character) in ("Cc", "Cf", "Cs", "Zl", "Zp"):
        return "\ufffd"
    return character


def _width(text: str) -> int:
    columns = 0
    for character in text:
        if unicodedata.combining(character) or unicodedata.category(character) in ("Mn", "Me"):
            continue
        columns += 2 if unicodedata.east_asian_width(character) in ("W", "F") else 1
    return columns
