"""Nobody is locked out by clients without a token, nor by one token; the emergency stop has a way in."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import websockets

from tests.e2e.servers import ServerProcess
from tests.gateway.conftest import GatewayProcess
from tests.gateway.test_http import ask
from tests.gateway.test_websocket import Client, opening

Tokens = tuple[Path, dict[str, str]]
HALF_OPEN = 1100
FILES = 1024


@pytest.fixture
def poor_gateway(server: ServerProcess, tokens: Tokens) -> Iterator[GatewayProcess]:
    """A gateway that may have no more than 1024 files open."""
    prlimit = shutil.which("prlimit")
    if prlimit is None:
        pytest.skip("prlimit is not installed")
    inside = (prlimit, f"--nofile={FILES}:{FILES}")
    made = GatewayProcess(server.endpoint, "--tokens", str(tokens[0]), inside=inside)
    yield made
    made.close()


@contextlib.contextmanager
def half_open(gateway: GatewayProcess, count: int) -> Iterator[list[socket.socket]]:
    """Requests whose head never ends."""
    where = urlsplit(gateway.url)
    with contextlib.ExitStack() as stack:
        made = []
        for _ in range(count):
            connection = stack.enter_context(
                socket.create_connection((where.hostname, where.port), timeout=60.0)
            )
            with contextlib.suppress(OSError):
                connection.sendall(b"POST /v1/machines/cell/estop HTTP/1.1\r\nHost: x\r\nX: ")
            made.append(connection)
        yield made


def test_half_open_requests_keep_neither_calls_nor_the_stop_out(
    poor_gateway: GatewayProcess, tokens: Tokens
) -> None:
    token = tokens[1]["operator"]
    with half_open(poor_gateway, HALF_OPEN):
        assert ask(poor_gateway, "/v1/machines/cell/status", token)[0] == 200
        stopped = ask(poor_gateway, "/v1/machines/cell/estop", token, {"reason": "in a crowd"})
        assert stopped == (200, {"ok": True})
        assert ask(poor_gateway, "/v1/machines/cell/reset", token, {})[0] == 200


async def test_one_token_fills_no_more_than_its_places_even_at_once(
    gateway: GatewayProcess, tokens: Tokens
) -> None:
    async def connected(token: str) -> websockets.ClientConnection | None:
        socket = await opening(gateway, token)
        with contextlib.suppress(websockets.ConnectionClosed):
            await Client(socket).receive()
        return None if socket.close_code == 4008 else socket

    greedy = await asyncio.gather(*(connected(tokens[1]["observer"]) for _ in range(60)))
    inside = [each for each in greedy if each is not None]
    assert len(inside) == 16
    honest = await connected(tokens[1]["engineer"])
    assert honest is not None
    for each in (*inside, honest):
        await each.close()
