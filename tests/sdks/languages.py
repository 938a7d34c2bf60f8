"""SDKs and their conformance programs: what builds each, with which tools.

Without the project's own environment: continuous integration builds them while that is being installed.
A language takes part by a function in `SDKS` that builds its conformance program and gives its command.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from typing import Literal

from tests.e2e.servers import ROOT
from tests.sdks import maven
from tests.sdks.built import build, build_once
from tests.sdks.cargo import cargo


class ToolMissing(Exception):
    """A language's tool is not installed, or too old."""


@dataclass(frozen=True)
class Sdk:
    """An SDK's conformance program: its command, and what it reaches a machine through."""

    command: tuple[str, ...]
    through: Literal["gateway", "zenoh"]


def python() -> Sdk:
    return Sdk((sys.executable, str(ROOT / "clients" / "python" / "conformance" / "main.py")), "zenoh")


def typescript() -> Sdk:
    node, npm = needed("node"), needed("npm")
    folder = ROOT / "clients" / "typescript"

    def compile_it() -> None:
        if not (folder / "node_modules" / "ws").is_dir():
            build([npm, "install", "--no-audit", "--no-fund", "--silent"], folder)
        build([npm, "run", "--silent", "build"], folder)

    sources = [folder / each for each in ("src", "package.json", "package-lock.json", "tsconfig.json")]
    build_once("typescript", sources, [folder / "dist", folder / "node_modules" / "ws"], compile_it)
    return Sdk((node, str(folder / "conformance" / "main.mjs")), "gateway")


def go() -> Sdk:
    folder = ROOT / "clients" / "go"
    made = ROOT / "build" / "go" / "conformance"
    build([go_tool(), "build", "-o", str(made), "./cmd/conformance"], folder)
    return Sdk((str(made),), "gateway")


def rust() -> Sdk:
    needed("cargo")
    cargo("build", "--locked", "--example", "conformance")
    return Sdk((str(ROOT / "clients" / "rust" / "target" / "debug" / "examples" / "conformance"),), "zenoh")


def java() -> Sdk:
    needed("java")
    needed("mvn")
    target = maven.FOLDER / "target"
    outputs = [target / "classes", target / "test-classes", target / "classpath"]
    build_once(
        "java",
        [maven.FOLDER / "src", maven.FOLDER / "pom.xml"],
        outputs,
        lambda: maven.maven("-DskipTests", "test"),
    )
    return Sdk((*maven.java(), "org.mcserver.client.Conformance"), "gateway")


SDKS = {each.__name__: each for each in (python, typescript, go, rust, java)}


def go_tool() -> str:
    """Go, of the version that the module needs: older ones than 1.21 do not fetch it by themselves.

    Raises:
        ToolMissing: Go is missing, or too old.
    """
    tool = needed("go")
    shown = subprocess.run([tool, "version"], capture_output=True, text=True, check=True).stdout
    version = re.search(r"go(\d+)\.(\d+)", shown)
    if version is None or (int(version[1]), int(version[2])) < (1, 21):
        raise ToolMissing(f"go is too old: {shown.strip()}")
    return tool


def needed(tool: str) -> str:
    """Path of a language's tool.

    Raises:
        ToolMissing: it is not installed.
    """
    found = shutil.which(tool)
    if found is None:
        raise ToolMissing(f"{tool} is not installed")
    return found
