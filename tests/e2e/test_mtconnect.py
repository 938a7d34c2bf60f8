"""`mcserver mtconnect` beside a real server: a program that runs, and a kill of the server."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator

import pytest
from mcclient.sync import Machine

from tests.e2e.conftest import slower
from tests.e2e.servers import ROOT, ServerProcess, environment

LOOKS = 3000


@pytest.fixture(scope="module")
def own_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("own")
    process = ServerProcess(folder, slower(folder, "cartesian"), "mill")
    process.start()
    yield process
    process.close()


@pytest.fixture(scope="module")
def agent(own_server: ServerProcess) -> Iterator[str]:
    """Where the agent is served."""
    command = [sys.executable, "-m", "mcserver", "mtconnect", "--port", "0", "--json", "--rate", "20"]
    process = subprocess.Popen(
        [*command, "--connect", own_server.endpoint],
        stdout=subprocess.PIPE,
        text=True,
        env=environment(),
        cwd=ROOT,
    )
    assert process.stdout is not None
    yield json.loads(process.stdout.readline())["url"]
    process.send_signal(signal.SIGTERM)
    assert process.wait(30.0) == 0
    process.stdout.close()


def read(address: str) -> str:
    with urllib.request.urlopen(address, timeout=30.0) as answer:
        return str(answer.read().decode())


def wait_for(address: str, is_there: Callable[[str], object]) -> str:
    """The first document in which it is there; a request takes milliseconds, the agent looks at 20 Hz."""
    for _ in range(LOOKS):
        document = read(address)
        if is_there(document):
            return document
    raise AssertionError(f"never in {document}")


def test_a_program_and_a_killed_server_are_observed_in_order(own_server: ServerProcess, agent: str) -> None:
    wait_for(f"{agent}probe", lambda document: 'name="mill"' in document)
    wait_for(f"{agent}current", lambda document: ">AVAILABLE<" in document)
    with Machine.connect("mill", own_server.endpoint) as machine, machine.program("part.nc") as program:
        program.send("G1010 P0")
        program.send("G01 X10 F600")
        wait_for(f"{agent}current", lambda document: ">ACTIVE<" in document and ">part.nc<" in document)
    wait_for(f"{agent}current", lambda document: ">PROGRAM_COMPLETED<" in document)
    own_server.end(signal.SIGKILL)
    wait_for(f"{agent}current", lambda document: ">AVAILABLE<" not in document)
    own_server.start()
    wait_for(f"{agent}current", lambda document: ">AVAILABLE<" in document)
    seen = read(f"{agent}mill/sample?count=100000&path=//Path|//Device/DataItems")
    assert re.findall(r"<Execution [^>]*>(\w+)<", seen)[-5:] == [
        "READY",
        "ACTIVE",
        "PROGRAM_COMPLETED",
        "UNAVAILABLE",
        "READY",
    ]
    numbers = [int(each) for each in re.findall(r'sequence="(\d+)"', seen)]
    assert len(numbers) == len(set(numbers))
