"""Split a program into lines that keep their ends, so that it can be written back as it was."""

from __future__ import annotations


def lines_with_ends(text: str) -> list[tuple[str, str]]:
    """Split a text into (line, end); the end is LF, CR LF, or empty for a last line without one (D-01)."""
    pieces = text.split("\n")
    last = pieces.pop()
    lines = [(piece[:-1], "\r\n") if piece.endswith("\r") else (piece, "\n") for piece in pieces]
    return [*lines, (last, "")] if last else lines
