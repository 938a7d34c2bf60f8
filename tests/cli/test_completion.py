"""Shell completion of commands, machines and files."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.cli.command import ENTRY, ROOT


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("mcserver sim", ["simulate"]),
        ("mcserver check --machine ro", ["robot-dog"]),
        ("mcserver check examples/ar", ["examples/arcs.gcode"]),
        ("mcserver check no-such-folder/a", []),
    ],
)
def test_what_is_typed_is_completed(typed: str, offered: list[str]) -> None:
    words = typed.split()
    asked = {"_MCSERVER_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run(
        [sys.executable, "-c", ENTRY],
        cwd=ROOT,
        env={**os.environ, **asked, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.stdout.split(), done.stderr) == (offered, "")
