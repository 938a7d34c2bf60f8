"""Runs Maven for the Java SDK, and programs on what it has built."""

from __future__ import annotations

import os
from pathlib import Path

from tests.e2e.servers import ROOT
from tests.sdks.built import build

FOLDER = ROOT / "clients" / "java"


def maven(*arguments: str) -> None:
    """Run goals; what the compiler warns of is an error."""
    build(["mvn", "-q", "-B", *arguments], FOLDER, LC_ALL="C.UTF-8")


def java(*classes: Path) -> tuple[str, ...]:
    """The command that runs a class on the SDK, once it is built; it may be in folders of its own."""
    built = FOLDER / "target"
    libraries = (built / "classpath").read_text("utf-8").strip()
    path = os.pathsep.join(map(str, [*classes, built / "classes", built / "test-classes", libraries]))
    # a small program: the first compiler alone starts it sooner
    return ("java", "-XX:TieredStopAtLevel=1", "-cp", path)
