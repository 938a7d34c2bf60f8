"""The documents name every code: those of the table, and those of the diagnostics."""

import re
from pathlib import Path

import pytest

from mcserver.gcode.line_faults import TITLES
from mcserver.gcode.text.command_table import COMMANDS, edit_distance, find_command

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "mcserver" / "gcode").rglob("*.py"))


def test_the_dialects_page_has_the_command_table() -> None:
    text = (ROOT / "docs" / "dialect.md").read_text("utf-8")
    rows = re.findall(r"^\| `([GM]\d+)` \| (.+?) \| (.*?) \|$", text, re.M)
    assert rows == [
        (
            spec.name,
            spec.title,
            ", ".join((["axis words"] if spec.takes_axes else []) + list(spec.words)) or "–",
        )
        for spec in COMMANDS
    ]


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
    documented = set(re.findall(r"^\| `(MC[12]\d\d|MC31\d)` \|", text, re.M))
    assert documented == set(TITLES)


@pytest.mark.parametrize("text", ["1", "01", "001", "0000001"])
def test_leading_zeros_do_not_matter(text: str) -> None:
    spec = find_command("G", text)
    assert spec is not None
    assert spec.name == "G01"


def test_edit_distance_counts_changes() -> None:
    assert edit_distance("G01", "G1020") == 3
    assert edit_distance("G01", "G01") == 0
    assert edit_distance("", "G0") == 2
