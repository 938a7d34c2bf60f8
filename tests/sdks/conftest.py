"""Each SDK's conformance program, built once; the server and the gateway are those of tests/gateway."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcclient import sync

from tests.e2e.servers import ROOT, ServerProcess
from tests.gateway.conftest import gateway, server, tokens

__all__ = ["gateway", "server", "tokens"]


@pytest.fixture(scope="session")
def typescript() -> list[str]:
    """The command of the TypeScript SDK's conformance program."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        pytest.skip("node and npm are not installed")
    folder = ROOT / "clients" / "typescript"
    if not (folder / "node_modules" / "ws").is_dir():
        subprocess.run([npm, "install", "--no-audit", "--no-fund", "--silent"], cwd=folder, check=True)
    subprocess.run([npm, "run", "--silent", "build"], cwd=folder, check=True)
    return [node, str(folder / "conformance" / "main.mjs")]


@pytest.fixture
def machine(server: ServerProcess) -> Iterator[sync.Machine]:
    """The server as another client sees it, at rest at X0 before each test."""
    with sync.Machine.connect("cell", server.endpoint) as made:
        with made.program("to zero") as program:
            program.send("G1010")
            program.send("G00 X0 Y0 Z0")
        yield made
        made.abort()
        while made.programs(ended=False):
            pass
        made.reset()


def environment() -> dict[str, str]:
    """Of a conformance program: no proxy between it and the loopback."""
    return {key: value for key, value in os.environ.items() if not key.lower().endswith("_proxy")}


def program_file(folder: Path, lines: list[str]) -> Path:
    path = folder / "program.gcode"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path
