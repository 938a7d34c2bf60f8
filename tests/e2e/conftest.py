"""Real servers, one a module, and clients of them over Zenoh on the loopback."""

from __future__ import annotations

import secrets
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import pytest
from mcclient import Machine
from mcclient.cli.app import run_command_line

from tests.e2e.servers import ROOT, START_LIMIT_S, ServerProcess
from tests.net.client import WireClient

Mcctl = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server of the built-in machine `cartesian`, shared by the tests of a module."""
    folder = tmp_path_factory.mktemp("cartesian")
    yield from served(folder, slower(folder, "cartesian"), "cell")


def slower(folder: Path, machine: str) -> str:
    """Write a built-in machine at a quarter of its rate, which costs a tenth of a core all the time.

    Machines at 1 kHz are those of test_restart.py, tests/fire and tests/e2e_can.
    """
    text = (ROOT / "mcserver" / "machine" / "builtin" / f"{machine}.toml").read_text("utf-8")
    changed = text.replace("cycle_hz = 1000", "cycle_hz = 250")
    assert changed != text
    file = folder / f"{machine}.toml"
    file.write_text(changed, "utf-8")
    return str(file)


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
def mcctl(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Mcctl:
    """Runs the command to its end in this process; tests/packaging has it as one of its own."""
    for name in ("MC_CONNECT", "MC_MACHINE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("COLUMNS", "400")
    monkeypatch.setenv("NO_COLOR", "1")

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        capfd.readouterr()
        code = run_command_line(list(arguments))
        shown = capfd.readouterr()
        return subprocess.CompletedProcess(arguments, code, shown.out, shown.err)

    return run
