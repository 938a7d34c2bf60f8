"""A diagnostic as a compiler would print it: the line, a caret under the place, the remedy."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Sequence

from rich.text import Text

from mcclient.cli.output import narration
from mcclient.cli.repeated import by_cause, further_lines
from mcclient.types import Diagnostic

MAX_SHOWN = 100
WINDOW = 100
TextOf = Callable[[int], str | None]


def render(diagnostic: Diagnostic, text: str | None, path: str) -> list[str]:
    """Return the diagnostic's lines, without colour.

    Args:
        text: the line's text; None: not known, no excerpt.
        path: the program's name.
    """
    place = f":{diagnostic.line}" if diagnostic.line else ""
    if diagnostic.line and diagnostic.column:
        place += f":{diagnostic.column}"
    lines = [f"{diagnostic.severity}[{diagnostic.code}]: {diagnostic.message}", f" --> {path}{place}"]
    margin = str(diagnostic.line) if diagnostic.line else ""
    if text is not None and diagnostic.line:
        shown, before, marked = _excerpt(text, diagnostic.column, diagnostic.end_column)
        lines.append(f"{margin} | {shown}".rstrip())
        if diagnostic.column:
            lines.append(f"{' ' * len(margin)} | {' ' * before}{'^' * marked}")
    if diagnostic.hint:
        lines.append(f"{' ' * max(1, len(margin))} = help: {diagnostic.hint}")
    return lines


def show_diagnostics(diagnostics: Sequence[Diagnostic], text_of: TextOf, path: str) -> None:
    """Show each cause once, on standard error."""
    console = narration()
    causes = by_cause(diagnostics)
    for diagnostic, lines in causes[:MAX_SHOWN]:
        head, *rest = render(diagnostic, text_of(diagnostic.line), path)
        console.print(Text(head, style="bold red" if diagnostic.severity == "error" else "bold yellow"))
        for line in rest:
            console.print(Text(line))
        if lines:
            console.print(Text(f"  = {further_lines(lines)}"))
    if len(causes) > MAX_SHOWN:
        console.print(f"… and {len(causes) - MAX_SHOWN} more; --json gives all of them")


def _excerpt(line: str, column: int, end_column: int) -> tuple[str, int, int]:
    """Return what is shown of a line, the columns before the mark, and the mark's width; columns are code
    points.
    """
    line = "".join(" " if not character.isprintable() else character for character in line)
    first = max(0, min(column - 1, len(line)))
    last = max(first + 1, end_column - 1)
    start = 0
    if len(line) > WINDOW:
        start = max(0, min(first - WINDOW // 2, len(line) - WINDOW))
    stop = min(len(line), start + WINDOW)
    lead = "…" if start else ""
    tail = "…" if stop < len(line) else ""
    before = len(lead) + _width(line[start:first])
    return lead + line[start:stop] + tail, before, max(1, _width(line[first : min(last, stop)]))


def _width(text: str) -> int:
    """Columns of a terminal."""
    columns = 0
    for character in text:
        if not unicodedata.combining(character):
            columns += 2 if unicodedata.east_asian_width(character) in ("W", "F") else 1
    return columns
