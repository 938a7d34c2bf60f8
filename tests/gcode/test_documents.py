"""The documents name every code: those of the table, and those of the diagnostics."""

import re
from pathlib import Path

import msgspec
import pytest

from mcserver.gcode.line_faults import TITLES
from mcserver.gcode.program_check import check_program
from mcserver.gcode.text.command_table import COMMANDS, CommandSpec, Kind, find_command
from mcserver.gcode.text.parser import scan_line
from mcserver.gcode.text.word_table import WORDS
from mcserver.gcode.text.words import LETTERS
from mcserver.language.rules import rules
from mcserver.language.tables import parts, renew
from mcserver.machine.follow_section import Follow
from mcserver.machine.machine_file import load_machine

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "mcserver" / "gcode").rglob("*.py"))


def test_the_dialects_page_holds_the_tables_and_rules_as_they_are() -> None:
    """``python -m mcserver.language.tables docs/dialect.md`` renews them."""
    text = (ROOT / "docs" / "dialect.md").read_text("utf-8")
    assert set(re.findall(r"^<!-- generated: (\w+) -->$", text, re.M)) == set(parts())
    assert renew(text) == text


@pytest.mark.parametrize("spec", COMMANDS, ids=lambda spec: spec.name)
def test_the_example_of_each_code_is_right(spec: CommandSpec) -> None:
    assert spec.name in spec.example
    machine = load_machine("cartesian")
    follow = Follow(0, 1e-3, 2.0, (), repeats=False, measured=False)
    axes = [
        msgspec.structs.replace(each, follow=follow if each.index == 3 else None) for each in machine.axes
    ]
    able = msgspec.structs.replace(machine, axes=tuple(axes))
    assert check_program(f"F6000\n{spec.example}", able) == []


@pytest.mark.parametrize("spec", COMMANDS, ids=lambda spec: spec.name)
def test_a_code_takes_the_words_that_its_row_names_and_no_others(spec: CommandSpec) -> None:
    for letter in "FIJKPRT":
        taken = "MC112" not in [fault.code for fault in scan_line(f"{spec.name} {letter}1", 1).faults]
        alone = letter in "FT" and spec.kind is Kind.SETTING
        if spec.kind is not Kind.PROGRAM and spec.kind is not Kind.SETTING:
            assert taken == (letter in spec.words), letter
        else:
            assert not alone or taken


def test_the_rules_of_codes_and_words_exist() -> None:
    named = {rule for spec in COMMANDS for rule in spec.rules} | {
        rule for spec in WORDS for rule in spec.rules
    }
    assert named <= set(rules())
    assert all(spec.rules and spec.example for spec in COMMANDS)


def test_every_letter_of_the_dialect_is_in_the_table_of_words() -> None:
    assert {letter for spec in WORDS for letter in spec.letters} == LETTERS - {"G", "M"} | {"[n]"}


def test_every_code_used_in_the_source_has_a_title_and_is_documented() -> None:
    used = {code for path in SOURCES for code in re.findall(r"MC[123]\d\d", path.read_text("utf-8"))}
    text = (ROOT / "docs" / "diagnostics.md").read_text("utf-8")
    documented = set(re.findall(r"^\| `(MC\d{3})` \|", text, re.M))
    assert used == set(TITLES)
    assert used <= documented
    for code, title in TITLES.items():
        assert f"| `{code}` | {title} |" in text


def test_no_code_of_the_dialect_is_documented_without_being_used() -> None:
    text = (ROOT / "docs" / "diagnostics.md").read_text("utf-8")
    documented = set(re.findall(r"^\| `(MC[12]\d\d|MC31\d|MC34\d)` \|", text, re.M))
    # the planner's: found as the line is planned
    assert documented - {"MC290"} == set(TITLES)


@pytest.mark.parametrize("text", ["1", "01", "001", "0000001"])
def test_leading_zeros_do_not_matter(text: str) -> None:
    spec = find_command("G", text)
    assert spec is not None
    assert spec.name == "G01"
