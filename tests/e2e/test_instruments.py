"""`mcserver mtconnect` and `opcua` beside a real server: clients of other makes, and kills."""

from __future__ import annotations

import importlib
import signal
import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from mcclient.sync import Machine

from tests.bench.server import free_port
from tests.e2e.conftest import slower
from tests.e2e.servers import CommandProcess, ServerProcess
from tests.peers import Peer, opcua_client, python_peers
from tests.sdks.languages import ToolMissing

LOOKS = 3000


@pytest.fixture(scope="module")
def own_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("own")
    process = ServerProcess(folder, slower(folder, "cartesian"), "mill")
    process.start()
    yield process
    process.close()


class Instrument:
    """A command that serves others, always at one port."""

    def __init__(self, command: str, endpoint: str, *options: str) -> None:
        self._words = (command, "--port", str(free_port()), "--connect", endpoint, *options)
        self.start()

    def start(self) -> None:
        self._command = CommandProcess(*self._words)
        self.url, self.close = self._command.url, self._command.close

    def kill(self) -> None:
        self._command.process.kill()
        self._command.close()


@pytest.fixture(scope="module")
def agent(own_server: ServerProcess) -> Iterator[Instrument]:
    process = Instrument("mtconnect", own_server.endpoint, "--rate", "20")
    yield process
    process.close()


class Reader:
    """The reader of MTConnect in iaiops: probe, current, pages of samples."""

    def __init__(self, url: str) -> None:
        self._reader: Any = importlib.import_module("iaiops.connectors.mtconnect.ops")
        self._agent = SimpleNamespace(name="mill", agent_url=url, device="mill")

    def components(self) -> set[str]:
        (device,) = self._reader.mtconnect_probe(self._agent)["devices"]
        return {each["component"] for each in device["components"]}

    def state(self) -> dict[str, Any]:
        found: dict[str, Any] = self._reader.mtconnect_oee_snapshot(self._agent)
        return found

    def samples(self) -> list[dict[str, str]]:
        """All that the agent has kept, page by page."""
        found = self._reader.mtconnect_stream(self._agent, from_sequence=1, interval_ms=0, count=50)
        assert found["stopped_reason"] == "caught_up"
        samples: list[dict[str, str]] = found["observations"]
        return samples

    def wait_for(self, is_there: Callable[[dict[str, Any]], object]) -> None:
        """Look until it is there: a request takes milliseconds, the agent looks at 20 Hz."""
        state: dict[str, Any] = {}
        for _ in range(LOOKS):
            state = self.state()
            if is_there(state):
                return
        raise AssertionError(f"never: {state}")


@pytest.fixture
def reader(agent: Instrument, monkeypatch: pytest.MonkeyPatch) -> Reader:
    monkeypatch.setattr(sys, "path", [*sys.path, str(python_peers())])
    return Reader(agent.url)


def test_a_client_of_another_make_sees_a_program_and_comes_back_after_a_kill_of_server_and_agent(
    own_server: ServerProcess, agent: Instrument, reader: Reader
) -> None:
    reader.wait_for(lambda state: state["verdict"] == "available_idle")
    assert {"Linear", "Controller", "Path"} <= reader.components()
    with Machine.connect("mill", own_server.endpoint) as machine, machine.program("part.nc") as program:
        program.send("G1010 P0")
        program.send("G01 X10 F600")
        reader.wait_for(lambda state: state["running"] and state["program"] == "part.nc")
    reader.wait_for(lambda state: state["execution"] == "PROGRAM_COMPLETED")
    own_server.end(signal.SIGKILL)
    reader.wait_for(lambda state: state["verdict"] == "unavailable")
    own_server.start()
    reader.wait_for(lambda state: state["available"])
    samples = reader.samples()
    assert [each["value"] for each in samples if each["type"] == "Execution"][-5:] == [
        "READY",
        "ACTIVE",
        "PROGRAM_COMPLETED",
        "UNAVAILABLE",
        "READY",
    ]
    numbers = [int(each["sequence"]) for each in samples]
    assert len(numbers) == len(set(numbers))
    agent.kill()
    agent.start()
    reader.wait_for(lambda state: state["available"])


async def test_an_opc_ua_client_of_another_make_sees_its_nodes_again_after_a_kill_of_the_instrument(
    own_server: ServerProcess,
) -> None:
    try:
        peer = Peer(opcua_client())
    except ToolMissing as missing:
        pytest.skip(str(missing))
    instrument = Instrument("opcua", own_server.endpoint)
    await peer.start(instrument.url)
    try:
        await peer.says("machine mill", "state 2 true")
        # whose server goes and comes: tests/opcua/test_server.py
        instrument.kill()
        instrument.start()
        await peer.says("state 2 true")
    finally:
        await peer.stop()
        instrument.close()
