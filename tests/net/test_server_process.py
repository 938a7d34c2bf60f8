"""A server and its executor as processes, over Zenoh on the loopback."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.net.client import WireClient

START_LIMIT_S = 30.0
STOP_LIMIT_S = 20.0

MACHINE = """
[machine]
name = "two"
[[axis]]
index = 0
type = "linear"
max_velocity = 500.0
max_acceleration = 5000.0
drive = { kind = "ideal" }
[[axis]]
index = 1
type = "rotary"
max_velocity = 360.0
max_acceleration = 3600.0
drive = { kind = "ideal" }
"""

SERVER = """
import asyncio, sys
from pathlib import Path
from mcserver.machine.machine_file import load_machine
from mcserver.net.configuration import NetworkOptions
from mcserver.server import ServerOptions, serve

asyncio.run(serve(load_machine(sys.argv[1]), ServerOptions(
    network=NetworkOptions(listen=("tcp/127.0.0.1:0",)),
    journal=Path(sys.argv[2]),
    on_ready=lambda endpoints: print(endpoints[0], flush=True),
)))
"""


class Server:
    """One start of the server after another, on the same machine and journal."""

    def __init__(self, folder: Path) -> None:
        self._machine = folder / "two.toml"
        self._machine.write_text(MACHINE, "utf-8")
        self._journal = folder / "journal.db"
        self.process: subprocess.Popen[str] | None = None
        self.clients: list[WireClient] = []

    async def start(self) -> WireClient:
        """Starts it, and a client of it."""
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVER, str(self._machine), str(self._journal)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        endpoint = await asyncio.wait_for(asyncio.to_thread(self.process.stdout.readline), START_LIMIT_S)
        self.clients.append(WireClient(endpoint.strip(), "two"))
        return self.clients[-1]

    async def end(self, number: signal.Signals) -> int:
        """Sends a signal; the exit code."""
        assert self.process is not None
        self.process.send_signal(number)
        code = await asyncio.to_thread(self.process.wait, STOP_LIMIT_S)
        self._forget()
        return code

    async def close(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self._forget()
        for client in self.clients:
            await client.close()

    def _forget(self) -> None:
        assert self.process is not None
        assert self.process.stdout is not None
        self.process.stdout.close()
        self.process = None


@pytest.fixture
async def server(tmp_path: Path) -> AsyncIterator[Server]:
    made = Server(tmp_path)
    yield made
    await made.close()


async def test_lines_move_the_axes_and_are_reported(server: Server) -> None:
    client = await server.start()
    program = (await client.call("open", name="demo"))["program"]
    acks, events = client.subscribe(f"ack/{program}"), client.subscribe("event")
    await client.call("status")
    lines = ["G1010", "G94 F12000", "G01 X20", "G93 F600 G01 [1]9"]
    await client.call("submit", program=program, first=1, lines=lines)
    await acks.first(lambda ack: ack["done"] == 4)
    ended = await events.first(
        lambda event: event["kind"] == "lines.ended" and event["lines"][-1]["line"] == 4
    )
    assert ended["lines"][-1]["requested_s"] == pytest.approx(0.1)
    status = await client.call("status")
    assert status["axes"]["position"] == pytest.approx([20.0, 9.0], abs=1e-6)
    assert status["axes"]["state"] == ["standstill", "standstill"]
    await client.call("close", program=program, last=4)
    await acks.first(lambda ack: ack["state"] == "finished")


async def test_a_killed_server_knows_the_last_line_and_resumes_only_when_asked(server: Server) -> None:
    client = await server.start()
    program = (await client.call("open"))["program"]
    acks = client.subscribe(f"ack/{program}")
    await client.call("status")
    await client.call(
        "submit", program=program, first=1, lines=["G1010", "G91 F6000", "G01 X5", "G01 X400 F60"]
    )
    await acks.first(lambda ack: ack["done"] == 3)
    await server.end(signal.SIGKILL)

    client = await server.start()
    (found,) = (await client.call("programs"))["programs"]
    assert (found["program"], found["state"]) == (program, "interrupted")
    assert (found["accepted"], found["done"]) == (4, 3)
    status = await client.call("status")
    assert status["axes"]["state"] == ["off", "off"]
    assert status["programs"] == []

    again = await client.call("open", resume_of=program, start_line=4)
    assert again["expected"] == 4
    acks = client.subscribe(f"ack/{again['program']}")
    await client.call("status")
    before = status["axes"]["position"][0]
    # G91 is remembered; the axis has to be captured anew
    await client.call("submit", program=again["program"], first=4, lines=["G1010", "F6000", "G01 X10"])
    await acks.first(lambda ack: ack["done"] == 6)
    status = await client.call("status")
    assert status["axes"]["position"][0] == pytest.approx(before + 10.0, abs=1e-6)


async def test_sigterm_stops_motion_and_leaves_a_clean_journal(server: Server) -> None:
    client = await server.start()
    program = (await client.call("open"))["program"]
    events = client.subscribe("event")
    await client.call("status")
    await client.call("submit", program=program, first=1, lines=["G1010", "G01 X400 F600"])
    await events.first(lambda event: event["kind"] == "lines.started" and event["line"] == 2)
    assert await server.end(signal.SIGTERM) == 0
    client = await server.start()
    (found,) = (await client.call("programs"))["programs"]
    assert (found["state"], found["done"]) == ("aborted", 1)
