"""The server under asyncio's debug mode, which refuses work in a loop that comes from another thread."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e.conftest import served, slower
from tests.e2e.servers import START_LIMIT_S, ServerProcess
from tests.net.client import WireClient


@pytest.fixture
def debugged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServerProcess]:
    monkeypatch.setenv("PYTHONASYNCIODEBUG", "1")
    yield from served(tmp_path, slower(tmp_path, "cartesian"), "debugged")


async def test_calls_streams_and_stops_are_served_in_debug_mode(debugged: ServerProcess) -> None:
    client = WireClient(debugged.endpoint, "debugged", "bench")
    try:
        program = (await client.call("open", axes=[0]))["program"]
        await client.call("hold", program=program)
        await client.call("submit", program=program, first=1, lines=["G1010 P0", "G04 P0"])
        client.put(client.lines_key(program), [3, ["G01 X1 F6000", "M02"]])
        await until(client, program, "accepted", 4)
        await client.call("resume", program=program)
        await until(client, program, "state", "finished")
        await client.call("estop", reason="in debug mode")
        assert (await client.call("status"))["state"] == "estop"
    finally:
        await client.close()
    said = "".join(debugged.said)
    assert "Traceback" not in said
    assert "Non-thread-safe" not in said


async def until(client: WireClient, program: str, what: str, value: object) -> None:
    """Ask for a program until ``what`` it says of itself has a value."""
    async with asyncio.timeout(START_LIMIT_S):
        while (await client.call("programs", program=program))["programs"][0][what] != value:
            await asyncio.sleep(0.01)
