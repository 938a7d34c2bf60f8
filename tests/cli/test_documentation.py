"""Documentation: each page is reachable, each link leads somewhere, and the picture is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cli.command import ROOT

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "deploy").rglob("*.md")),
]
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_relative_link_leads_to_a_file(page: Path) -> None:
    targets = [target for target in LINK.findall(page.read_text("utf-8")) if "://" not in target]
    assert [target for target in targets if not (page.parent / target).exists()] == []


def test_the_index_reaches_every_page() -> None:
    index = (ROOT / "docs" / "README.md").read_text("utf-8")
    linked = {Path(target).name for target in LINK.findall(index)}
    assert {page.name for page in (ROOT / "docs").glob("*.md")} - {"README.md"} <= linked


def test_the_readme_shows_a_picture_of_the_product() -> None:
    assert "docs/images/arcs.png" in (ROOT / "README.md").read_text("utf-8")
    assert (ROOT / "docs" / "images" / "arcs.png").read_bytes().startswith(b"\x89PNG")
