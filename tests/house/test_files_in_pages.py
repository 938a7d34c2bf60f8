"""What pages name exists, and what begins with a number sign is a heading that was meant."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = ("mcserver", "kinematics", "clients", "tests", "examples", "editors", "deploy")
FOLDERS_OF_PAGES = (
    "docs",
    "clients/contract",
    "clients/python",
    "clients/benchmark",
    "clients/gym",
    "clients/lerobot",
    "deploy",
    "kinematics",
    "examples",
)
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(page for folder in FOLDERS_OF_PAGES for page in (ROOT / folder).rglob("*.md")),
]
# a path of at least one folder; the last part is a file
FILE = re.compile(r"(?<![\w./-])((?:[\w-]+/)+[\w-]+\.py)\b")


@pytest.fixture(scope="module")
def sources() -> set[str]:
    """Every Python file with every end of its path."""
    ends = set()
    for folder in SOURCES:
        for path in (ROOT / folder).rglob("*.py"):
            parts = path.relative_to(ROOT).parts
            ends.update("/".join(parts[first:]) for first in range(len(parts)))
    return ends


def named(page: Path) -> set[str]:
    return set(FILE.findall(page.read_text("utf-8")))


@pytest.mark.parametrize("page", [page for page in PAGES if named(page)], ids=lambda page: page.stem)
def test_every_file_that_a_page_names_exists(page: Path, sources: set[str]) -> None:
    assert named(page) - sources == set()


def test_pages_name_files() -> None:
    assert len(named(ROOT / "docs" / "motion.md")) > 10


def test_no_parameter_of_a_program_begins_a_line_of_prose_where_it_would_be_a_heading() -> None:
    found = []
    for page in PAGES:
        prose = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
        found += [(page.name, line) for line in prose.splitlines() if re.match(r"#+[^\s#]", line)]
    assert found == []


def test_no_line_of_prose_is_longer_than_a_screen_of_an_editor() -> None:
    found = []
    for page in PAGES:
        prose = re.sub(r"^ *```.*?^ *```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
        found += [
            (page.name, line)
            for line in prose.splitlines()
            if len(line) > 120 and not line.startswith(("|", "[", "!"))
        ]
    assert found == []
