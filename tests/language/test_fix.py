"""Certain remedies are applied, uncertain ones are left to people; formatting changes no meaning."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.cli.app import run_command_line
from mcserver.errors import Diagnostic, Edit
from mcserver.gcode.line_faults import TITLES
from mcserver.gcode.program_check import check_program
from mcserver.gcode.text.parser import scan_line
from mcserver.language.fix import fix_program, select_edits
from mcserver.language.format import format_line, format_program, same_code
from mcserver.language.grammar.derive import derive
from mcserver.language.grammar.dialect import build_grammar
from mcserver.machine.machine_file import load_machine, parse_machine
from tests.machine_text import axes_text

CARTESIAN = load_machine("cartesian")
GRAMMAR = build_grammar(CARTESIAN)
AXIS = axes_text(velocity=500.0, acceleration=5000.0)


def check(text: str) -> Sequence[Diagnostic]:
    return check_program(text, CARTESIAN)


@pytest.mark.parametrize(
    ("line", "fixed"),
    [
        ("GO1 XO", "G01 X0"),
        ("GO1 X1O", "G01 X10"),
        ("G01 [O]5", "G01 [0]5"),
        ("G01 X−5", "G01 X-5"),
        ("G01 X５", "G01 X5"),
        ("G01 X5\u00a0Y5", "G01 X5 Y5"),
        ("G01\u00a0X5", "G01 X5"),
        ("G01 X1 (a (b) c)", "G01 X1 (a b c)"),
        ("G01 X1,", "G01 X1"),
        ("G01 X1,, Y2", "G01 X1, Y2"),
        ("G01 X1 X1", "G01 X1 "),
        ("G01 F100 X5 F100", "G01 F100 X5 "),
    ],
)
def test_a_certain_remedy_makes_the_line_right(line: str, fixed: str) -> None:
    done = fix_program(f"F600\n{line}", check)
    assert done.text == f"F600\n{fixed}"
    assert done.remaining == ()
    assert done.applied


def test_the_page_says_of_every_code_of_a_line_whether_a_remedy_is_certain() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "language.md").read_text("utf-8")
    table = page.partition("| code | certain where |")[2].partition("\n\n")[0]
    rows = [[cell.strip() for cell in row.split("|")[1:3]] for row in table.splitlines()[2:]]
    said: set[str] = set()
    for codes, _ in rows:
        for part in codes.split(", "):
            first, _, last = part.partition(" … ")
            said |= {f"MC{number}" for number in range(int(first[2:]), int((last or first)[2:]) + 1)}
    assert {code for code in TITLES if code.startswith("MC1")} <= said
    lines = ["GO1", "X−5", "(a (b) c)", "X1,", "X1 X1"]
    found = {each.code for line in lines for each in check(f"F600\nG01 {line}") if each.edit is not None}
    assert found == {codes for codes, certain in rows if certain}


@pytest.mark.parametrize(
    "line",
    [
        *("G01 X1 X2", "G01 X1e5", "G1 X10E5", "G01 X--5", "G01 X", "693 X1", "G02 X100 Y0 R10", "G04 X2"),
        *("G1010 G01 X1", "G01 X1 (open", "G01 X9999", "G05", "F0", "G01 X1\rG01 X2", "G01 X5\u00a05"),
    ],
)
def test_what_may_mean_two_things_is_left_to_people(line: str) -> None:
    done = fix_program(f"F600\n{line}", check)
    assert done.text == f"F600\n{line}"
    assert done.applied == ()
    assert done.remaining


PIECES = st.sampled_from(
    [
        *(
            "G01",
            "GO1",
            "X1",
            "XO",
            "X−5",
            "Y５",
            "[O]2",
            ",",
            "(a (b) c)",
            "F100",
            "\u00a0",
            " ",
            "é",
            ")",
            "(",
        ),
        "X",
    ]
)


@settings(max_examples=300)
@given(st.lists(PIECES, max_size=8).map("".join))
def test_edits_stay_within_their_line_and_none_is_left_when_all_are_applied(line: str) -> None:
    for fault in scan_line(line, 2).faults:
        if fault.edit is not None:
            assert 1 <= fault.edit.column <= fault.edit.end_column <= len(line) + 1
    done = fix_program(f"F600\n{line}", check)
    assert select_edits(done.remaining) == []
    assert len(done.remaining) <= len(check(f"F600\n{line}")) or done.applied


def test_remedies_that_overlap_are_applied_one_after_the_other() -> None:
    first = Diagnostic("MC101", "", line=1, column=1, end_column=4, edit=Edit(1, 4, "G01"))
    second = Diagnostic("MC105", "", line=1, column=3, end_column=5, edit=Edit(3, 5, "1 "))
    third = Diagnostic("MC105", "", line=2, column=1, end_column=2, edit=Edit(1, 2, ""))
    assert select_edits([third, second, first]) == [first, third]


def test_the_remedy_is_in_the_answer_for_machines() -> None:
    (fault,) = check("GO1")
    assert fault.as_json()["edit"] == {"column": 2, "end_column": 4, "text": "01"}
    assert all("edit" not in fault.as_json() for fault in check("G01 X9999 F5"))


@pytest.mark.parametrize(
    ("line", "formatted"),
    [
        ("g1x+5y.5", "G01 X5 Y0.5"),
        ("  G 001  X 5. ", "G01 X5"),
        ("n10 g1010p0", "N10 G1010 P0"),
        ("G01 [ 07 ]-.5,G2 X1 y2 r007.50", "G01 [7]-0.5, G02 X1 Y2 R7.50"),
        ("G01 X-0", "G01 X-0"),
        ("g4p.5;wait", "G04 P0.5  ;wait"),
        ("G01 X1        ; aligned ", "G01 X1        ; aligned"),
        ("g1(to)x1(there) ;x", "G01 (to) X1 (there)  ;x"),
        ("; only a comment", "; only a comment"),
        ("%  a title", "%  a title"),
        ("", ""),
        ("GO1 x1", "GO1 x1"),
    ],
)
def test_a_line_is_formatted(line: str, formatted: str) -> None:
    assert format_line(line) == formatted
    assert format_line(formatted) == formatted


@settings(max_examples=200)
@given(st.integers(0, 2**32))
def test_formatting_keeps_every_word_and_is_done_once(seed: int) -> None:
    text = derive(GRAMMAR, Random(seed))
    once = format_program(text)
    assert format_program(once) == once
    assert len(once.split("\n")) - len(text.split("\n")) in (0, 1)
    for line, formatted in zip(text.split("\n"), once.split("\n"), strict=False):
        assert same_code(line, formatted)
    # columns may move, nothing else
    assert [(fault.code, fault.line) for fault in check(once)] == [
        (fault.code, fault.line) for fault in check(text)
    ]


@pytest.mark.parametrize("text", ["G1", "G1\n", "G1\r\n", "G1\r", "G4 P0.\r", "G3 X0 Y0 I1000 J0 P2 \r"])
def test_a_text_that_is_cut_in_its_last_end_of_line_is_formatted_once(text: str) -> None:
    once = format_program(text)
    assert format_program(once) == once


def test_fix_writes_the_file_with_its_line_ends_and_shows_the_difference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.gcode"
    path.write_bytes(b"\xef\xbb\xbfG94 F600\r\nGO1 XO\r\nG01 X1")
    assert run_command_line(["fix", str(path), "--dry-run"]) == 0
    assert b"GO1" in path.read_bytes()
    assert run_command_line(["fix", str(path)]) == 0
    assert path.read_bytes() == b"\xef\xbb\xbfG94 F600\r\nG01 X0\r\nG01 X1"
    shown = capsys.readouterr().out
    assert "-GO1 XO" in shown
    assert "+G01 X0" in shown


def test_fix_says_what_remains(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "p.gcode"
    path.write_text("F600\nGO1 X1 X2\n")
    assert run_command_line(["fix", str(path), "--json"]) == 4
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"] is False
    assert [each["code"] for each in answer["applied"]] == ["MC101"]
    assert [each["code"] for each in answer["diagnostics"]] == ["MC111"]


def test_format_checks_without_writing(tmp_path: Path) -> None:
    path = tmp_path / "p.gcode"
    path.write_text("g1x5")
    assert run_command_line(["format", str(path), "--check"]) == 1
    assert path.read_text() == "g1x5"
    assert run_command_line(["format", str(path)]) == 0
    assert path.read_text() == "G01 X5\n"
    assert run_command_line(["format", str(path), "--check"]) == 0


@pytest.mark.parametrize("profile", ["cnc", "robot"])
@pytest.mark.parametrize(
    ("line", "fixed"), [("GO1 X1O", "G01 X10"), ("G1 X-1O.5", "G1 X-10.5"), ("G1 XO", "G1 X0")]
)
def test_the_letter_o_among_digits_has_its_remedy_in_profiles(profile: str, line: str, fixed: str) -> None:
    machine = parse_machine(f'[machine]\nname = "m"\n[dialect]\nprofile = "{profile}"\n{AXIS}')
    text = f"G90 F600\n{line}\n"
    faults = [each for each in check_program(text, machine) if each.severity == "error"]
    assert {each.code for each in faults} == {"MC101"}
    text = fix_program(text, lambda each: check_program(each, machine)).text
    assert text.split("\n")[1] == fixed
