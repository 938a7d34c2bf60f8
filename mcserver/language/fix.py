"""Apply the certain remedies of diagnostics to a program's text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import msgspec

from mcserver.errors import Diagnostic, Edit

MAX_ROUNDS = 8  # a remedy may uncover a fault that has one too

Check = Callable[[str], Sequence[Diagnostic]]


class Fixed(msgspec.Struct, frozen=True):
    """A program after its remedies.

    Attributes:
        text: with every certain remedy applied.
        applied: the diagnostics whose remedies were applied, in order.
        remaining: the diagnostics of the new text.
    """

    text: str
    applied: tuple[Diagnostic, ...]
    remaining: tuple[Diagnostic, ...]


def fix_program(text: str, check: Check) -> Fixed:
    """Apply certain remedies until none is left.

    Args:
        text: the program, without a byte order mark.
        check: finds the faults of a text, as `mcserver.gcode.program_check.check_program` does.
    """
    applied: list[Diagnostic] = []
    remaining = tuple(check(text))
    for _ in range(MAX_ROUNDS):
        usable = select_edits(remaining)
        if not usable:
            break
        text = apply_edits(text, usable)
        applied += usable
        remaining = tuple(check(text))
    return Fixed(text, tuple(applied), remaining)


def select_edits(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return the diagnostics with a remedy, the first of each that overlap, in reading order."""
    usable: list[Diagnostic] = []
    with_edit = [
        (each.line, each.edit, each) for each in diagnostics if each.edit is not None and each.line > 0
    ]
    with_edit.sort(key=lambda entry: (entry[0], entry[1].column, entry[1].end_column))
    line, end = 0, 0
    for at, edit, diagnostic in with_edit:
        if at != line or edit.column >= end:
            usable.append(diagnostic)
            line, end = at, edit.end_column
    return usable


def apply_edits(text: str, diagnostics: Sequence[Diagnostic]) -> str:
    """Apply remedies that do not overlap; line ends stay as they are."""
    lines = lines_with_ends(text)
    for diagnostic in reversed(diagnostics):
        if diagnostic.edit is not None and diagnostic.line <= len(lines):
            line, end = lines[diagnostic.line - 1]
            lines[diagnostic.line - 1] = (apply_edit(line, diagnostic.edit), end)
    return "".join(line + end for line, end in lines)


def lines_with_ends(text: str) -> list[tuple[str, str]]:
    """Split a text into (line, end); the end is LF, CR LF, or empty for a last line without one (D-01)."""
    pieces = text.split("\n")
    last = pieces.pop()
    lines = [(piece[:-1], "\r\n") if piece.endswith("\r") else (piece, "\n") for piece in pieces]
    return [*lines, (last, "")] if last else lines


def apply_edit(line: str, edit: Edit) -> str:
    """Replace the characters that an edit names."""
    return line[: edit.column - 1] + edit.text + line[edit.end_column - 1 :]
