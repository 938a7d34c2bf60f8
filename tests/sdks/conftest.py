"""Each SDK's conformance program, built once; one server of 64 axes and one gateway to it for all tests.

A language takes part by a function in `SDKS` that builds its conformance program and gives its command.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest
from mcclient import sync

from tests.e2e.servers import ROOT, ServerProcess
from tests.gateway.conftest import GatewayProcess, cell, tokens
from tests.sdks import maven
from tests.sdks.built import build_once
from tests.sdks.cargo import cargo

__all__ = ["tokens"]

AXES = 64
BUILD_LIMIT_S = 900.0


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
    """Go, of the version that the module needs: older ones than 1.21 do not fetch it by themselves."""
    tool = needed("go")
    shown = subprocess.run([tool, "version"], capture_output=True, text=True, check=True).stdout
    version = re.search(r"go(\d+)\.(\d+)", shown)
    if version is None or (int(version[1]), int(version[2])) < (1, 21):
        pytest.skip(f"go is too old: {shown.strip()}")
    return tool


def needed(tool: str) -> str:
    """Path of a language's tool; the test is skipped by its name where it is not installed."""
    found = shutil.which(tool)
    if found is None:
        pytest.skip(f"{tool} is not installed")
    return found


def build(command: list[str], folder: Path) -> str:
    """Build, with the registry's proxy if there is one, and say why where it fails; what was printed."""
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=BUILD_LIMIT_S, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="session", params=SDKS)
def sdk(request: pytest.FixtureRequest) -> Sdk:
    """One SDK's conformance program, built."""
    return SDKS[request.param]()


@pytest.fixture(scope="package")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("server")
    (folder / "cell.toml").write_text(cell(AXES), "utf-8")
    made = ServerProcess(folder, str(folder / "cell.toml"), "cell")
    made.start()
    yield made
    made.close()


@pytest.fixture(scope="package")
def gateway(server: ServerProcess, tokens: tuple[Path, dict[str, str]]) -> Iterator[GatewayProcess]:
    made = GatewayProcess(server.endpoint, "--tokens", str(tokens[0]))
    yield made
    made.close()


@pytest.fixture
def machine(server: ServerProcess) -> Iterator[sync.Machine]:
    """The server as another client sees it, at rest at X0 before each test."""
    with sync.Machine.connect("cell", server.endpoint) as made:
        to_zero(made)
        yield made
    with sync.Machine.connect("cell", server.endpoint) as made:
        made.abort()
        while made.programs(ended=False):
            pass
        made.reset()


def to_zero(machine: sync.Machine) -> None:
    """Axes have energy and are at zero."""
    with machine.program("to zero", axes=[0, 1]) as program:
        program.send("G1010")
        program.send("G00 X0 Y0")


def environment() -> dict[str, str]:
    """Of a conformance program: no proxy between it and the loopback; the Python SDK from its folder."""
    kept = {key: value for key, value in os.environ.items() if not key.lower().endswith("_proxy")}
    return {**kept, "PYTHONPATH": str(ROOT / "clients" / "python")}


def program_file(folder: Path, lines: list[str]) -> Path:
    path = folder / "program.gcode"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path
