"""The modules of each SDK use each other in one direction."""

from __future__ import annotations

import re
from collections.abc import Callable
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.e2e.servers import ROOT

CLIENTS = ROOT / "clients"


def python(text: str, _: set[str]) -> set[str]:
    return set(re.findall(r"^ *from mcclient\.([\w.]+) import", text, re.M))


def typescript(text: str, _: set[str]) -> set[str]:
    return set(re.findall(r'from "\./(\w+)\.js"', text))


def rust(text: str, _: set[str]) -> set[str]:
    return set(re.findall(r"\bcrate::(\w+)::", text))


def java(text: str, classes: set[str]) -> set[str]:
    # classes of one package are used without an import
    code = re.sub(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"', "", text, flags=re.DOTALL)
    return classes & set(re.findall(r"\w+", code))


Uses = Callable[[str, set[str]], set[str]]


@pytest.mark.parametrize(
    ("folder", "ending", "uses"),
    [
        ("python/mcclient", ".py", python),
        ("typescript/src", ".ts", typescript),
        ("rust/src", ".rs", rust),
        ("java/src/main/java/org/mcserver/client", ".java", java),
    ],
    ids=["python", "typescript", "rust", "java"],
)
def test_no_modules_of_an_sdk_form_a_circle(folder: str, ending: str, uses: Uses) -> None:
    root = CLIENTS / folder
    files = {
        _module(file.relative_to(root)): file.read_text("utf-8")
        for file in root.rglob(f"*{ending}")
        if "test" not in file.stem
    }
    assert len(files) > 5
    graph = {name: (uses(text, set(files)) & set(files)) - {name} for name, text in files.items()}
    TopologicalSorter(graph).prepare()


def _module(path: Path) -> str:
    return ".".join(path.with_suffix("").parts)
