"""Lines that change work offsets and tools, and that take a change back."""

from __future__ import annotations

import pytest
from mcclient.types import TableChange
from mcclient.work_tables import change_text, offset_line, tool_line, undo_line


def change(row: str, before: dict[str, float], after: dict[str, float]) -> TableChange:
    return TableChange(wall=1.0, client="hmi", program="p1", name="", row=row, before=before, after=after)


def test_an_offset_is_set_by_a_line() -> None:
    assert offset_line("G54", {"0": 12.5, "6": -1e-9}) == "G21 G90 G10 L2 P1 X12.5 [6]0"
    assert offset_line("G54", {"0": 12.5, "R": 30.0}) == "G21 G90 G10 L2 P1 X12.5 R30"
    assert offset_line("G59.3", {"2": -0.1}) == "G21 G90 G10 L2 P9 Z-0.1"


def test_a_tool_is_set_by_a_line() -> None:
    assert tool_line(3, 75.2, 6.0) == "G21 G90 G10 L1 P3 Z75.2 R3"


@pytest.mark.parametrize(
    ("made", "line"),
    [
        (change("G55", {"0": 1.0}, {"0": 2.0, "1": 5.0}), "G21 G90 G10 L2 P2 X1 Y0"),
        (
            change("T3", {"length": 10.0, "diameter": 0.0}, {"length": 20.0, "diameter": 6.0}),
            "G21 G90 G10 L1 P3 Z10 R0",
        ),
        (change("T3", {}, {"length": 20.0, "diameter": 6.0}), None),
    ],
)
def test_a_change_is_taken_back_by_a_line(made: TableChange, line: str | None) -> None:
    assert undo_line(made) == line


def test_a_change_is_told_by_what_differs() -> None:
    assert change_text(change("G55", {"0": 1.0, "1": 3.0}, {"0": 2.0, "1": 3.0})) == "G55: X 1 → 2"
    assert change_text(change("T3", {}, {"length": 20.0, "diameter": 0.0})) == (
        "T3: length – → 20, diameter – → 0"
    )
