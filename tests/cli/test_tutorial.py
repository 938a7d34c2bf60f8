"""Each command of the tutorial that needs no server really runs, in its order, in a fresh folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.command import ENTRY, EXAMPLES, ROOT

TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
# what needs a server, is one, or the environment that is being made
ELSEWHERE = re.compile(r"make |source |mcctl |mcserver run|mcserver view|mcserver doctor")


def commands() -> list[str]:
    """Lines after a prompt, in reading order."""
    return [line[2:] for line in TUTORIAL.splitlines() if line.startswith("$ ")]


def test_the_tutorial_has_commands_for_both_sides() -> None:
    assert {command.split()[0] for command in commands()} >= {"mcserver", "mcctl", "make"}


@pytest.mark.timeout(600)
def test_each_command_of_the_tutorial_runs(tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(EXAMPLES)
    shim = tmp_path / "bin" / "mcserver"
    shim.parent.mkdir()
    shim.write_text(f"#!/bin/sh\nexec '{sys.executable}' -c '{ENTRY}' \"$@\"\n")
    shim.chmod(0o755)
    environment = {**os.environ, "PATH": f"{shim.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    codes = []
    for command in commands():
        if ELSEWHERE.match(command):
            continue
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            timeout=100,
            check=False,
        )
        assert b"Traceback" not in done.stderr
        codes.append((command, done.returncode))
    # the first check shows what a rejection looks like
    rejected = [command for command, code in codes if code == 4]
    assert rejected == ["mcserver check out/first.gcode"]
    assert {code for _, code in codes} == {0, 4}
    assert (tmp_path / "out" / "gait.png").exists()
