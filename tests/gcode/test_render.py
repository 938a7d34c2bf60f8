"""Diagnostics as a compiler shows them."""

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.errors import Diagnostic
from mcserver.gcode.line_faults import TITLES
from mcserver.gcode.program_check import check_program
from mcserver.gcode.render import excerpt, render
from tests.gcode.support import CARTESIAN


def rendered(text: str) -> str:
    lines = text.split("\n")
    faults = check_program(text, CARTESIAN)
    shown = (
        render(fault, lines[fault.line - 1], "pick.gcode", TITLES.get(fault.code, "")) for fault in faults
    )
    return "\n".join(line for each in shown for line in each)


def test_the_chord_fault_reads_as_in_the_style_guide() -> None:
    program = "F100\n" + "\n" * 10 + "G02 X100 Y0 R30"
    assert rendered(program) == "\n".join(
        [
            "error[MC104]: the chord is longer than the diameter",
            " --> pick.gcode:12:13",
            "12 | G02 X100 Y0 R30",
            "   |             ^^^ the chord is 100 mm, so R must be at least 50 mm",
            "   = help: use R50, or give the centre with I and J",
        ]
    )


def _caret_column(text: str) -> tuple[str, int]:
    """The character above the first caret, by columns of a terminal."""
    _, _, source, carets, *_ = text.split("\n")
    column = carets.index("^")
    at = 0
    for character in source:
        if at >= column and not unicodedata.combining(character):
            return character, at - column
        at += (
            0
            if unicodedata.combining(character)
            else 2
            if unicodedata.east_asian_width(character) in "WF"
            else 1
        )
    return "", 0


@pytest.mark.parametrize(
    "before", ["", "\t", "(宽字符) ", "(e\u0301a\u0300) ", "\t(\uff21)\t\t", "(" + "x" * 300 + ")"]
)
def test_carets_stand_under_the_fault_behind_tabs_wide_and_combining_characters(before: str) -> None:
    assert _caret_column(rendered(f"F1\n{before}G01 X--1")) == ("X", 0)


def test_long_lines_are_cut_around_the_place() -> None:
    text = rendered("F1\nG01 " + " " * 5_000 + "X--1 " + " " * 3_000 + "Y1")
    assert max(len(line) for line in text.split("\n")) < 160
    assert _caret_column(text) == ("X", 0)


def test_a_diagnostic_without_a_line_has_no_excerpt() -> None:
    fault = Diagnostic(code="MC302", message="the point is out of reach", hint="come nearer")
    assert render(fault, None, "a.gcode") == [
        "error[MC302]: the point is out of reach",
        " --> a.gcode",
        "  = help: come nearer",
    ]


@given(st.text(max_size=300), st.integers(0, 310), st.integers(0, 310))
def test_excerpts_are_bounded_and_printable(line: str, column: int, end_column: int) -> None:
    shown, before, marked = excerpt(line, column, end_column)
    assert marked >= 1
    assert before >= 0
    assert not any(unicodedata.category(character) == "Cc" for character in shown)
    assert len(shown) <= 4 * 100 + 2
