"""Runs Maven for the Java SDK, and programs on what it has built."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from tests.e2e.servers import ROOT

FOLDER = ROOT / "clients" / "java"
# Zenoh, or Maven's downloads, on a busy computer [s].
BUILD_LIMIT_S = 900.0


def maven(*arguments: str) -> None:
    """Run goals; what the compiler warns of is an error."""
    done = subprocess.run(
        ["mvn", "-q", "-B", *arguments],
        cwd=FOLDER,
        env={**os.environ, "LC_ALL": "C.UTF-8"},
        capture_output=True,
        text=True,
        timeout=BUILD_LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def java(*classes: Path) -> tuple[str, ...]:
    """The command that runs a class on the SDK, once it is built; it may be in folders of its own."""
    built = FOLDER / "target"
    libraries = (built / "classpath").read_text("utf-8").strip()
    path = os.pathsep.join(map(str, [*classes, built / "classes", built / "test-classes", libraries]))
    # a small program: the first compiler alone starts it sooner
    return ("java", "-XX:TieredStopAtLevel=1", "-cp", path)
