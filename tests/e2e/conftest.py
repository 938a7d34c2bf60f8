"""Real servers, one a module, and clients of them over Zenoh on the loopback."""

from __future__ import annotations

import secrets
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import pytest
from mcclient import Machine

from tests.e2e.servers import ROOT, START_LIMIT_S, ServerProcess, environment
from tests.net.client import WireClient

Mcctl = Callable[..., "subprocess.CompletedProcess[str]"]
COMMAND_LIMIT_S = 40.0


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server of the built-in machine `cartesian`, shared by the tests of a module."""
    yield from served(tmp_path_factory.mktemp("cartesian"), "cartesian", "cell")


@pytest.fixture(scope="module")
def dog_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server of the built-in machine `robot-dog`."""
    pytest.importorskip("pinocchio")
    yield from served(tmp_path_factory.mktemp("dog"), "robot-dog", "dog")


@pytest.fixture
def own_server(tmp_path: Path) -> Iterator[ServerProcess]:
    """A server that a test may end and start as it likes."""
    yield from served(tmp_path, "cartesian", "own")


def served(folder: Path, machine: str, name: str, *, recorder: bool = False) -> Iterator[ServerProcess]:
    process = ServerProcess(folder, machine, name, recorder=recorder)
    try:
        process.start()
        yield process
    finally:
        process.close()
        # pytest shows it where a test failed
        sys.stderr.write("".join(process.said))


@pytest.fixture
async def machine(server: ServerProcess) -> AsyncIterator[Machine]:
    """A client of the shared server."""
    async with connected(server) as made:
        yield made


@pytest.fixture
async def wire(server: ServerProcess) -> AsyncIterator[WireClient]:
    """A client of the shared server that writes the wire by hand."""
    # the server remembers answers by the client's id
    made = WireClient(server.endpoint, server.name, f"by-hand-{secrets.token_hex(4)}")
    yield made
    await made.close()


def connected(server: ServerProcess) -> Machine:
    """A connection to enter with ``async with``."""
    return Machine.connect(server.name, server.endpoint, timeout_s=START_LIMIT_S)  # type: ignore[return-value]


@pytest.fixture
def mcctl() -> Mcctl:
    """Runs the command to its end."""

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "mcclient", *arguments],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=COMMAND_LIMIT_S,
            env=environment(),
            cwd=ROOT,
            check=False,
        )

    return run
