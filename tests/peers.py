"""Clients of other makes that read what is served for the field: ``python -m tests.peers`` installs them.

`tests/peers.txt` has those of Python. They ask for older versions of packages that are here in newer ones,
and what is used of them runs with these: they stand in a folder of their own and bring nothing along.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.e2e.servers import ROOT
from tests.sdks.built import build_once
from tests.sdks.languages import ToolMissing, build, go_tool, needed

REQUIREMENTS = ROOT / "tests" / "peers.txt"
PYTHON = ROOT / "build" / "peers"
FOXGLOVE = ROOT / "tests" / "gateway" / "client"
OPCUA = ROOT / "tests" / "opcua" / "client"


class Peer:
    """A client of another make in a process of its own, by the lines that it says.

    Args:
        command: without its arguments.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._command = command
        self._process: asyncio.subprocess.Process

    async def start(self, *arguments: object) -> None:
        words = [str(each) for each in arguments]
        self._process = await asyncio.create_subprocess_exec(
            *self._command, *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL
        )

    async def says(self, *beginnings: str) -> list[str]:
        """Lines up to the one that begins with the last of these; those between may be others."""
        assert self._process.stdout is not None
        wanted, found = list(beginnings), []
        async with asyncio.timeout(60.0):
            while wanted:
                line = (await self._process.stdout.readline()).decode().rstrip()
                assert line, f"it ended without {wanted[0]!r}: {found}"
                found.append(line)
                if line.startswith(wanted[0]):
                    wanted.pop(0)
        return found

    async def stop(self) -> None:
        if self._process.returncode is None:
            self._process.kill()
        await self._process.wait()


def python_peers() -> Path:
    """Return the folder that has those of Python, to be put on the path."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-compile"]
    options = ["--no-deps", "--require-hashes", "--upgrade", "--target", str(PYTHON), "-r", str(REQUIREMENTS)]
    outputs = [PYTHON / each for each in ("grafana_foundation_sdk", "iaiops", "pysparkplug")]
    build_once("peers", [REQUIREMENTS], outputs, lambda: build([*pip, *options], ROOT))
    return PYTHON


def foxglove_client() -> list[str]:
    """Return the command of a viewer that is Foxglove's own client.

    Raises:
        ToolMissing: node or npm is not installed.
    """
    node, npm = needed("node"), needed("npm")
    manifests = [FOXGLOVE / "package.json", FOXGLOVE / "package-lock.json"]
    install = [npm, "ci", "--no-audit", "--no-fund", "--silent"]
    build_once("foxglove", manifests, [FOXGLOVE / "node_modules"], lambda: build(install, FOXGLOVE))
    return [node, str(FOXGLOVE / "main.cjs")]


def opcua_client() -> list[str]:
    """Return the command of a client of OPC UA that is built on gopcua.

    Raises:
        ToolMissing: Go is not installed.
    """
    made = ROOT / "build" / "go" / "opcua-client"
    command = [go_tool(), "build", "-o", str(made), "."]
    build_once("opcua", [OPCUA], [made], lambda: build(command, OPCUA))
    return [str(made)]


def main() -> None:
    """Install all whose tools are here."""
    python_peers()
    try:
        foxglove_client()
    except ToolMissing as missing:
        sys.stderr.write(f"Foxglove's client: not installed, {missing}\n")


if __name__ == "__main__":
    main()
