"""A server that a stranger has made deaf: its programs are held, and clients of both doors come back."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcclient import Machine

from tests.e2e.conftest import served
from tests.e2e.servers import ServerProcess
from tests.gateway.conftest import GatewayProcess, cell
from tests.gateway.test_websocket import Client, Tokens, opening
from tests.net.deafening import deafen

LIMIT_S = 60.0


@pytest.fixture
def deaf_server(tmp_path: Path) -> Iterator[ServerProcess]:
    """A server of its own, which others need not come back to."""
    (tmp_path / "cell.toml").write_text(cell(3, cycle_hz=250), "utf-8")
    yield from served(tmp_path, str(tmp_path / "cell.toml"), "cell")


async def state_of(machine: Machine, program: str) -> str:
    """The state of a program, as its client is told."""
    (told,) = await machine.programs(program)
    return told.state


@pytest.mark.timeout(3 * LIMIT_S)
async def test_clients_of_a_deaf_server_come_back_and_go_on(
    deaf_server: ServerProcess, tokens: Tokens
) -> None:
    through = GatewayProcess(deaf_server.endpoint, "--tokens", str(tokens[0]))
    try:
        async with (
            asyncio.timeout(2 * LIMIT_S),
            Machine.connect("cell", deaf_server.endpoint) as machine,
            opening(through, tokens[1]["engineer"]) as socket,
        ):
            web = Client(socket)
            await web.receive()
            program = await machine.program(axes=[0])
            await program.send("G1010 P0")
            await program.send("G01 X300 F300")
            await asyncio.to_thread(deafen, deaf_server.endpoint, "cell")
            while await state_of(machine, program.id) != "held":
                await asyncio.sleep(0.1)
            await gateway_answers(web)
            assert any("MC525" in line and program.id in line for line in deaf_server.said)
            await machine.resume(program.id)
            assert await state_of(machine, program.id) == "running"
            await machine.abort(program.id)
    finally:
        through.close()


async def gateway_answers(client: Client) -> None:
    """Wait until a call through the gateway is answered."""
    while True:
        reply: dict[str, Any] = await client.ask("call", machine="cell", method="status", params={})
        if reply["ok"]:
            return
        await asyncio.sleep(0.1)
