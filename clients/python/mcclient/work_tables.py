"""The lines of G-code that change work offsets and tools, and that take a change back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from mcclient.types import TableChange, ToolRow, WorkOffset

SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
LETTERS = "XYZABC"
# of a tool [min]
LIFE = ("life", "used")


def work_places(
    offsets: Sequence[WorkOffset], positions: Mapping[int, float], system: str = "G54"
) -> dict[int, float]:
    """Return what axes at ``positions``, by number, read in a work coordinate system [mm, deg]."""
    found = next((each for each in offsets if each.system == system), None)
    if found is None:
        return dict(positions)
    reads = {axis: at - found.origin.get(str(axis), 0.0) for axis, at in positions.items()}
    if found.rotation and {0, 1} <= reads.keys():
        cosine, sine = math.cos(math.radians(found.rotation)), math.sin(math.radians(found.rotation))
        reads[0], reads[1] = cosine * reads[0] + sine * reads[1], cosine * reads[1] - sine * reads[0]
    return reads


def offset_line(system: str, origin: Mapping[str, float]) -> str:
    """Return the line that sets where a system reads zero.

    Args:
        system: such as ``G54``.
        origin: by axis number [mm, deg], and ``R``, its rotation [deg]; what is left out stays.
    """
    words = [f"{_axis(axis)}{_number(value)}" for axis, value in origin.items()]
    return f"G21 G90 G10 L2 P{SYSTEMS.index(system) + 1} {' '.join(words)}"


def tool_line(number: int, length: float, diameter: float) -> str:
    """Return the line that sets a tool's length and diameter [mm]."""
    return f"G21 G90 G10 L1 P{number} Z{_number(length)} R{_number(diameter / 2.0)}"


def undo_row(change: TableChange) -> dict[str, Any] | None:
    """Return what ``set_table_row`` takes a name's or a life's change back by; None: it is another."""
    back: dict[str, Any] = {f"{each}_min": change.before[each] for each in LIFE if each in change.before}
    if change.was_called != change.called:
        back["name"] = change.was_called
    return {"row": change.row, **back} if back else None


def undo_line(change: TableChange) -> str | None:
    """Return the line that takes a change back; None where a tool was not in the table before it.

    Names and lives have none: `undo_row`.
    """
    if undo_row(change) is not None:
        return None
    if change.row in SYSTEMS:
        return offset_line(change.row, {**dict.fromkeys(change.after, 0.0), **change.before})
    if not change.before:
        return None
    return tool_line(int(change.row[1:]), change.before["length"], change.before["diameter"])


def change_text(change: TableChange) -> str:
    """Return what a change did, such as ``G54: X 0 → 12.5``."""
    parts = []
    for name in {**change.before, **change.after}:
        was, is_now = change.before.get(name), change.after.get(name)
        if was != is_now:
            parts.append(f"{_axis(name)} {'–' if was is None else _number(was)} → {_number(is_now or 0.0)}")
    if change.was_called != change.called:
        parts.append(f"{change.was_called or '–'} → {change.called or '–'}")
    return f"{change.row}: {', '.join(parts)}"


def use_text(tool: ToolRow) -> str:
    """Return for how long a tool has cut, such as ``12.5 of 60``; empty: never, and nobody said how long."""
    if tool.life_min:
        return f"{tool.used_min:.1f} of {tool.life_min:g}"
    return f"{tool.used_min:.1f}" if tool.used_min else ""


def _axis(name: str) -> str:
    if not name.isdecimal():
        return name
    return LETTERS[int(name)] if int(name) < len(LETTERS) else f"[{name}]"


def _number(value: float) -> str:
    text = f"{value:.6f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
