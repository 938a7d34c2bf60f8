"""The grammar derives programs that parse, and every program that is shipped; near misses it does not."""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path
from random import Random

import lark
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.gcode.program_check import check_program
from mcserver.gcode.text.parser import scan_line
from mcserver.gcode.text.source import split_lines
from mcserver.language.grammar.derive import derive
from mcserver.language.grammar.dialect import build_grammar
from mcserver.language.grammar.expressions import Grammar
from mcserver.language.grammar.notations import Notation, write_grammar, write_regex
from mcserver.machine.machine_file import load_machine
from tests.language.grammar_reader import Recognizer, pattern_of, read_grammar
from tests.machine_text import axes_text

ROOT = Path(__file__).resolve().parents[2]
PLAIN = str(ROOT / "tests" / "golden" / "machines" / "plain.toml")
MACHINES = ("cartesian", "robot-dog", "arm6", PLAIN)
# 10 000 by GRAMMAR_PROGRAMS=10000
PROGRAMS = int(os.environ.get("GRAMMAR_PROGRAMS", "300"))
SHIPPED = sorted([*(ROOT / "tests" / "golden").glob("*.gcode"), *(ROOT / "examples").glob("*.gcode")])


@cache
def grammar_of(machine: str) -> Grammar:
    return build_grammar(load_machine(machine) if machine else None)


@cache
def recognizer(machine: str) -> Recognizer:
    return Recognizer(grammar_of(machine))


@cache
def lark_parser(machine: str) -> lark.Lark:
    return lark.Lark(write_grammar(grammar_of(machine), Notation.LARK), parser="earley")


def faults(text: str, machine: str) -> list[str]:
    """Codes of the faults that a grammar can know of: text, grammar, absent axes and tools."""
    codes = [
        fault.code
        for number, line in enumerate(split_lines(text), 1)
        for fault in scan_line(line, number).faults
    ]
    known = check_program(text, load_machine(machine))
    return codes + [fault.code for fault in known if fault.code in ("MC108", "MC310", "MC311")]


@pytest.mark.parametrize("machine", MACHINES)
def test_programs_derived_from_the_grammar_have_no_fault_of_text_axis_or_tool(machine: str) -> None:
    random = Random(1)
    for _ in range(PROGRAMS // len(MACHINES)):
        text = derive(grammar_of(machine), random)
        assert faults(text, machine) == [], text


def test_lines_of_the_grammar_for_any_machine_parse() -> None:
    random = Random(2)
    for _ in range(PROGRAMS):
        line = derive(grammar_of(""), random, "line")
        assert scan_line(line, 2).faults == (), line


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_program_can_be_derived_unless_its_text_is_faulty(path: Path) -> None:
    lines = split_lines(path.read_text("utf-8"))
    faulty = any(scan_line(line, number).faults for number, line in enumerate(lines, 1))
    assert all(map(recognizer("robot-dog").accepts, lines)) != faulty
    try:
        lark_parser("robot-dog").parse(path.read_text("utf-8"))
    except lark.exceptions.LarkError:
        assert faulty
    else:
        assert not faulty


NEAR_MISSES = (
    *("GO1 X1", "G1 XO", "G01 X1 X2", "G01 X1 [0]2", "G01 X1 U2", "G01 X1,", ",G01 X1", "G01 X1,, Y2"),
    *("G01 X", "G01 X1e5", "G01 X--1", "G01 X1.2.3", "G01 F0", "G01 F-5", "G01 F100 X1 F200", "G01 X1 R5"),
    *("G02 X1 Y1", "G02 X1 R5 I5", "G02 X1 Y1 R5 P0", "G02 X1 Y1 R5 P1.5", "G04", "G04 X1", "G04 P-1"),
    *(
        "G04 P1 G01 X1",
        "G00 X1 G01 Y1",
        "G1020 X1 G1030 Y1",
        "G1030 U5",
        "G1040 F5 X1",
        "G1010 X0",
        "G1010 G01 X1",
    ),
    *(
        "G1010 P3",
        "G1010 P64",
        "G01 A5",
        "G01 [3]5",
        "G01 [64]5",
        "T1",
        "G01 T3 X1",
        "G05",
        "G999",
        "M03",
        "M06",
    ),
    *(
        "G01 G94 X1 F5 F6",
        "X1 G01",
        "G01 X1 G91 Y1",
        "(open",
        "G01 X1 )",
        "G01 X1 (a (b))",
        "% G01 X1",
        "G64 P-1",
    ),
    *(
        "G01 X1 N5",
        "N1.5 G01 X1",
        "N-1",
        "G01 X\u00a05",
        "G01 X\uff15",
        "G1.5 X1",
        "S1000",
        "G01 X1 M00 G01 Y1",
    ),
)


@pytest.mark.parametrize("line", NEAR_MISSES)
def test_near_misses_cannot_be_derived(line: str) -> None:
    assert not recognizer(PLAIN).accepts(line)
    with pytest.raises(lark.exceptions.LarkError):
        lark_parser(PLAIN).parse(line)


@settings(max_examples=200)
@given(st.integers(0, 2**32), st.sampled_from(MACHINES))
def test_what_the_grammar_accepts_of_spoiled_lines_parses(seed: int, machine: str) -> None:
    random = Random(seed)
    line = derive(grammar_of(machine), random, "line")
    for _ in range(random.randrange(1, 4)):
        at = random.randrange(len(line) + 1)
        other = random.choice(
            ["", *"GXYF019.-+,[]();% \tOIJKRPTNM", derive(grammar_of(machine), random, "moves")]
        )
        line = line[:at] + other + line[at + random.randrange(2) :]
    if recognizer(machine).accepts(line):
        assert faults(line, machine) == [], line


@pytest.mark.parametrize("notation", [Notation.EBNF, Notation.GBNF])
@pytest.mark.parametrize("machine", ["robot-dog", PLAIN])
def test_what_is_printed_rule_by_rule_is_the_same_language(notation: Notation, machine: str) -> None:
    start, rules = read_grammar(write_grammar(grammar_of(machine), notation))
    assert start == ("root" if notation is Notation.GBNF else "program")
    printed = re.compile(pattern_of(rules, "line"))
    random = Random(3)
    for _ in range(50):
        line = derive(grammar_of(machine), random, "line")
        assert printed.fullmatch(line), line
    for line in NEAR_MISSES:
        assert bool(printed.fullmatch(line)) == recognizer(machine).accepts(line), line
    assert not printed.fullmatch("GO1 X1")


def test_the_regular_expression_stands_for_whole_programs_without_references() -> None:
    written = write_grammar(grammar_of(PLAIN), Notation.REGEX).removesuffix("\n")
    assert "(?=" not in written
    assert "(?!" not in written
    pattern = re.compile(written)
    assert pattern.fullmatch("G94 F6000\nG01 X1 Y2\r\n")
    assert not pattern.fullmatch("G94 F6000\nG01 X1 X2\n")


def test_a_machine_without_tools_has_no_word_t_and_one_with_tools_only_its_own() -> None:
    assert "tool" not in grammar_of("cartesian").rules
    legs = re.compile(write_regex(grammar_of("robot-dog"), "tool"))
    assert [tool for tool in range(20) if legs.fullmatch(f"T{tool}")] == [3, 6, 9, 12]


def test_a_machine_of_rotary_axes_has_no_arcs(tmp_path: Path) -> None:
    path = tmp_path / "turntable.toml"
    path.write_text(f'[machine]\nname = "turntable"\n{axes_text([3], rotary=True)}')
    accepts = Recognizer(build_grammar(load_machine(str(path)))).accepts
    assert accepts("G01 A90 F60")
    assert accepts("[3]45")
    assert not accepts("G02 A5 R5")
    assert not accepts("G01 X1")
