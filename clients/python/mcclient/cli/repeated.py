# mcserver/gcode/repeated.py, by python -m mcserver.contract.sdk clients: change it there
"""Show diagnostics with the same cause once, with the other lines' numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence

from mcclient.types import Diagnostic

# a measure or a word's number, but not a code's: M73 and M107 are two causes, F0.2 and F0.25 one
_MEASURE = re.compile(r"(?<![GMTNO_\[0-9.])(?<![a-z])[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
SHOWN_LINES = 4


def by_cause(diagnostics: Sequence[Diagnostic]) -> list[tuple[Diagnostic, list[int]]]:
    """Return the first diagnostic of each cause and the further lines that have it, in order.

    Diagnostics have one cause if their code and axis are the same and their messages differ in measures only.
    """
    causes: dict[tuple[str, str, int | None, str], tuple[Diagnostic, list[int]]] = {}
    for each in diagnostics:
        shape = _MEASURE.sub("#", each.message)
        first, lines = causes.setdefault((each.code, each.severity, each.axis, shape), (each, []))
        if each.line not in (first.line, lines[-1] if lines else 0):
            lines.append(each.line)
    return list(causes.values())


def further_lines(lines: Sequence[int]) -> str:
    """Name the further lines of a cause; empty without any."""
    if not lines:
        return ""
    shown = ", ".join(str(line) for line in lines[:SHOWN_LINES])
    if len(lines) > SHOWN_LINES:
        shown += f" … {lines[-1]}"
    count = "1 more line" if len(lines) == 1 else f"{len(lines)} more lines"
    return f"and on {count}: {shown}"
