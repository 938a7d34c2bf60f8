"""The ten hops of a line through the code, as docs/motion.md tells them."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "motion.md").read_text("utf-8")
HOP = re.compile(r"^## (?P<number>\d+)\. .+\n`(?P<file>[^`]+)` · `(?P<name>[^`]+)`$", re.MULTILINE)
HOPS = [(hop["file"], hop["name"]) for hop in HOP.finditer(PAGE)]
# functions and classes that the page names on the way, such as `LineQueue.take`
NAMED = sorted(set(re.findall(r"`([A-Z]\w+\.[a-z]\w+)`", PAGE)))
LONGEST_LINE = 120


def definition(scope: ast.Module | ast.ClassDef, name: str) -> ast.stmt | None:
    kinds = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    return next((each for each in scope.body if isinstance(each, kinds) and each.name == name), None)


@pytest.fixture(scope="module")
def methods() -> set[str]:
    """Every method of a class in the server and the Python SDK, as ``Class.method``."""
    found = set()
    for folder in ("mcserver", "clients/python/mcclient"):
        for path in (ROOT / folder).rglob("*.py"):
            for each in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(each, ast.ClassDef):
                    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
                    found.update(f"{each.name}.{part.name}" for part in each.body if isinstance(part, kinds))
    return found


@pytest.mark.parametrize(("file", "name"), HOPS)
def test_every_hop_exists(file: str, name: str) -> None:
    scope: ast.stmt | ast.Module | None = ast.parse((ROOT / file).read_text("utf-8"))
    for part in name.split("."):
        assert isinstance(scope, ast.Module | ast.ClassDef), f"{file} has no {name}"
        scope = definition(scope, part)
    assert scope is not None, f"{file} has no {name}"


def test_what_is_named_on_the_way_exists(methods: set[str]) -> None:
    assert set(NAMED) - methods == set()
    assert len(NAMED) > 10


def test_ten_hops_lead_from_the_client_to_the_executor() -> None:
    assert [int(hop["number"]) for hop in HOP.finditer(PAGE)] == list(range(1, 11))
    assert HOPS[0][0].startswith("clients/")
    assert HOPS[-1][0].startswith("mcserver/executor/")


@pytest.mark.parametrize("page", ["motion.md", "planner.md"])
def test_lines_are_short(page: str) -> None:
    lines = (ROOT / "docs" / page).read_text("utf-8").splitlines()
    assert [number for number, line in enumerate(lines, 1) if len(line) >= LONGEST_LINE] == []
