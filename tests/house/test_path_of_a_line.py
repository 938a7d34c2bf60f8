"""The walk of a line through the code, as docs/motion.md describes it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "motion.md").read_text("utf-8")
ROW = re.compile(r"^\|(?P<handoff>[^|]*)\|[^|]*\| `(?P<file>[^`]+)` \| `(?P<name>[^`]+)` \|$", re.MULTILINE)
STEPS = [(row["file"], row["name"]) for row in ROW.finditer(PAGE)]


def definition(scope: ast.Module | ast.ClassDef, name: str) -> ast.stmt | None:
    kinds = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    return next((each for each in scope.body if isinstance(each, kinds) and each.name == name), None)


@pytest.mark.parametrize(("file", "name"), STEPS)
def test_every_step_of_the_path_exists(file: str, name: str) -> None:
    scope: ast.stmt | ast.Module | None = ast.parse((ROOT / file).read_text("utf-8"))
    for part in name.split("."):
        assert isinstance(scope, ast.Module | ast.ClassDef), f"{file} has no {name}"
        scope = definition(scope, part)
    assert scope is not None, f"{file} has no {name}"


def test_the_path_goes_from_the_client_to_the_drive_in_at_most_eight_handoffs() -> None:
    assert STEPS[0][0].startswith("clients/")
    assert STEPS[-1][1] == "AxisBank.exchange"
    handoffs = [row["handoff"].strip() for row in ROW.finditer(PAGE) if "⇒" in row["handoff"]]
    assert handoffs == [f"{number} ⇒" for number in range(1, len(handoffs) + 1)]
    assert 1 <= len(handoffs) <= 8
