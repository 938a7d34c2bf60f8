"""Completion, hover and folding, from the tables of the dialect and the machine."""

from __future__ import annotations

import pytest
from mcbenchmark.families import machine_file

from mcserver.gcode.text.command_table import COMMANDS
from mcserver.language.agents.knowledge import dialect_topic, fault_facts
from mcserver.language.lsp.knowledge import complete, hover, words_of
from mcserver.language.lsp.outline import folding_ranges
from mcserver.machine.machine_file import Machine, load_machine

CARTESIAN = load_machine("cartesian")
DOG = load_machine("robot-dog")
MILL = load_machine(machine_file("mill"))


def labels(line: str, machine: object = CARTESIAN) -> list[str]:
    return [each.label for each in complete(line, len(line), machine)]  # type: ignore[arg-type]


def test_an_empty_line_offers_every_code_and_the_axes() -> None:
    offered = labels("")
    assert [spec.name for spec in COMMANDS] == offered[: len(COMMANDS)]
    assert {"X", "Y", "Z", "A", "[6]", "F"} <= set(offered)


def test_a_code_is_completed_from_what_is_written_of_it() -> None:
    numbers = (1000, 1001, 1002, 1010, 1011, 1020, 1030, 1040, 1050, 1060, 1061)
    assert labels("G10") == [f"G{number}" for number in numbers]
    assert "G01" in labels("G1")
    assert labels("G01 X5 m3") == ["M30"]


def test_behind_a_code_its_own_words_are_offered_once() -> None:
    offered = set(labels("G02 X5 "))
    assert {"Y", "I", "R", "P", "F"} <= offered
    assert "X" not in offered
    assert not {"I", "R", "P"} & set(labels("G01 "))
    assert "P" in labels("G04 ")
    assert "X" not in labels("G04 ")


def test_tools_are_those_of_the_machine() -> None:
    assert labels("T", DOG) == ["T3", "T6", "T9", "T12"]
    assert "T3" in labels("G01 ", DOG)
    assert labels("T") == []


@pytest.mark.parametrize("line", ["; G0", "G01 (X", "G01 ;"])
def test_comments_offer_nothing(line: str) -> None:
    assert labels(line) == []


def test_hover_shows_the_code_its_words_and_its_rule() -> None:
    found = hover("N10 g2 X5 Y5 R10", 5, CARTESIAN)
    assert found is not None
    text, start, end = found
    assert (start, end) == (4, 6)
    assert "G02" in text
    assert "D-22" in text
    assert "radius" in text


def test_hover_on_an_axis_word_shows_the_machines_axis() -> None:
    found = hover("G01 [ 3 ]90", 6, CARTESIAN)
    assert found is not None
    assert "axis 3 of cartesian is rotary" in found[0]
    found = hover("G01 X5", 4, CARTESIAN)
    assert found is not None
    assert "-5000 … 5000 mm" in found[0]


@pytest.mark.parametrize(("line", "at"), [("G01 X5 ; X", 9), ("G999", 1), ("   ", 1), ("", 0), ("H5", 0)])
def test_what_means_nothing_has_no_hover(line: str, at: int) -> None:
    assert hover(line, at, CARTESIAN) is None


def test_words_in_comments_are_no_words() -> None:
    assert [word.name for word in words_of("G01 (X5) Y2 ; Z3")] == ["G", "Y"]


def test_comment_blocks_and_what_stands_under_them_fold() -> None:
    lines = ["; a", "; b", "G01 X1", "G01 X2", "", "(c)", "G01 X3", "G01 X4 ; not a head", ""]
    assert sorted(folding_ranges(lines)) == [(0, 1, True), (0, 3, False), (5, 7, False)]
    assert folding_ranges([]) == []
    assert folding_ranges(["; only"]) == []


@pytest.mark.parametrize(
    ("line", "own", "others"),
    [
        ("G81 ", "RLKXYZF", "PQIJ"),
        ("G98 G083 Z-5 Q1 ", "RLPIJK", "QZ"),
        ("G82 ", "RPLK", "QIJ"),
        ("G84 ", "RQLK", "PIJ"),
    ],
)
def test_behind_a_canned_cycle_its_own_words_are_offered(line: str, own: str, others: str) -> None:
    offered = labels(line, MILL)
    assert set(own) <= set(offered)
    assert not set(others) & set(offered)
    assert len(offered) == len(set(offered))
    assert "R" not in labels(line)


def test_a_word_of_a_canned_cycle_is_explained_as_that() -> None:
    def shown(line: str, letter: str, machine: Machine) -> str:
        found = hover(line, line.index(letter) + 1, machine)
        return "" if found is None else found[0]

    assert "drills from" in shown("G81 Z-5 R2", "R", MILL)
    assert "peck" in shown("G83 Z-5 R2 Q1", "Q", MILL)
    assert "radius" in shown("G2 X1 Y1 R2", "R", MILL)
    assert "radius" in shown("G2 X1 Y1 R2", "R", CARTESIAN)


def test_agents_are_told_every_meaning_of_a_word() -> None:
    assert "peck" in dialect_topic("Q", MILL)
    assert "peck" not in dialect_topic("Q", CARTESIAN)
    assert all(each in dialect_topic("R", MILL) for each in ("radius", "drills from"))


def test_a_fault_of_some_axis_is_not_said_of_axis_0() -> None:
    assert fault_facts("MC472")["title"].startswith("axis … is further")
