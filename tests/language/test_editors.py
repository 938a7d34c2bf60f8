"""The files for editors fit the dialect and each other."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from mcserver.gcode.text.command_table import COMMANDS
from mcserver.language.textmate import textmate_grammar

VSCODE = Path(__file__).resolve().parents[2] / "editors" / "vscode"


def scope_of(text: str) -> str:
    """The scope of the first pattern that matches at the start of a text."""
    for pattern in json.loads(textmate_grammar())["patterns"]:
        if re.match(pattern["match"], text):
            return str(pattern.get("name") or pattern["captures"]["1"]["name"])
    return ""


def test_the_textmate_grammar_is_current() -> None:
    """``python -m mcserver.language.textmate editors/vscode/syntaxes/gcode.tmLanguage.json`` renews it."""
    assert (VSCODE / "syntaxes" / "gcode.tmLanguage.json").read_text("utf-8") == textmate_grammar()


@pytest.mark.parametrize("spec", COMMANDS, ids=lambda spec: spec.name)
def test_every_code_is_coloured_as_one(spec: object) -> None:
    name = spec.name  # type: ignore[attr-defined]
    for written in (name, name.lower(), f"{name[0]}{int(name[1:])}", f"{name[0]} 00{int(name[1:])} X5"):
        assert scope_of(written) not in ("", "invalid.illegal.code.gcode"), written


@pytest.mark.parametrize(
    ("text", "scope"),
    [
        ("G05", "invalid.illegal.code.gcode"),
        ("G10", "invalid.illegal.code.gcode"),
        ("G1.5", "invalid.illegal.code.gcode"),
        ("; G01", "comment.line.semicolon.gcode"),
        ("(G01) X5", "comment.block.gcode"),
        ("[ 7]-.5", "variable.parameter.axis.gcode"),
        ("x5", "variable.parameter.axis.gcode"),
        ("F600", "entity.name.tag.gcode"),
        ("N10 G01", "constant.other.line-number.gcode"),
    ],
)
def test_words_and_comments_are_coloured(text: str, scope: str) -> None:
    assert scope_of(text) == scope


def test_what_the_extension_names_is_there() -> None:
    about = json.loads((VSCODE / "package.json").read_text("utf-8"))
    named = [about["main"], about["contributes"]["grammars"][0]["path"]]
    named.append(about["contributes"]["languages"][0]["configuration"])
    assert all((VSCODE / name).is_file() for name in named)
    json.loads((VSCODE / "language-configuration.json").read_text("utf-8"))
