"""Each command of the tutorial that needs no server really runs, in its order, in a fresh folder."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from mcserver.cli.app import run_command_line
from tests.cli.command import EXAMPLES, ROOT

TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
# what needs a server, is one, or the environment that is being made
ELSEWHERE = re.compile(r"make |source |mcctl |mcserver run|mcserver view|mcserver doctor")


def commands() -> list[str]:
    """Lines after a prompt, in reading order."""
    return [line[2:] for line in TUTORIAL.splitlines() if line.startswith("$ ")]


def test_the_tutorial_has_commands_for_both_sides() -> None:
    assert {command.split()[0] for command in commands()} >= {"mcserver", "mcctl", "make"}


def run_here(command: str) -> int:
    """Run one, and give its exit code: those of mcserver in this process, those of the shell by a shell."""
    words = shlex.split(command)
    if words[0] == "mcserver":
        return run_command_line(words[1:])
    return subprocess.run(["bash", "-c", command], check=False).returncode


def test_each_command_of_the_tutorial_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "examples").symlink_to(EXAMPLES)
    monkeypatch.chdir(tmp_path)
    codes = [(command, run_here(command)) for command in commands() if not ELSEWHERE.match(command)]
    # the first check shows what a rejection looks like
    rejected = [command for command, code in codes if code == 4]
    assert rejected == ["mcserver check out/first.gcode"]
    assert {code for _, code in codes} == {0, 4}
    assert (tmp_path / "out" / "gait.png").exists()
