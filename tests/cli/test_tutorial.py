"""Each command of the tutorial that needs no server really runs, in its order, in a fresh folder."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cli.command import EXAMPLES
from tests.cli.pages import commands_of, read_page, run_here

TUTORIAL = read_page("tutorial.md")
# what needs a server, is one, or the environment that is being made
ELSEWHERE = re.compile(r"make |source |mcctl |mcserver run|mcserver view|mcserver doctor")


def test_the_tutorial_has_commands_for_both_sides() -> None:
    assert {command.split()[0] for command in commands_of(TUTORIAL)} >= {"mcserver", "mcctl", "make"}


def test_each_command_of_the_tutorial_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "examples").symlink_to(EXAMPLES)
    monkeypatch.chdir(tmp_path)
    here = [command for command in commands_of(TUTORIAL) if not ELSEWHERE.match(command)]
    codes = [(command, run_here(command)) for command in here]
    # the first check shows what a rejection looks like
    rejected = [command for command, code in codes if code == 4]
    assert rejected == ["mcserver check out/first.gcode"]
    assert {code for _, code in codes} == {0, 4}
    assert (tmp_path / "out" / "gait.png").exists()
