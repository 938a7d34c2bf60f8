"""The recipes' files are written, and their commands that need no server really run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cli.pages import commands_of, read_page, run_here, write_files

RECIPES = read_page("recipes.md")
# what needs a server or a bus, is a server, or changes this computer
ELSEWHERE = re.compile(
    r"pip |sqlite3 |mcctl |mcserver (run|view|web|mcp|ros|scan|drives|doctor|history|security|recordings)\b"
    r"|.*(cell\.toml|/etc/)"
)


def test_files_and_commands_of_the_recipes_do_what_they_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = write_files(RECIPES, tmp_path)
    commands = [each for each in commands_of(RECIPES) if not ELSEWHERE.match(each)]
    assert {run_here(command) for command in commands} == {0}
    # none of the files stands there for nothing
    assert {name for name in names if not any(name in command for command in commands)} == set()
    assert len(commands) >= 8
    assert (tmp_path / "plate.png").exists()
