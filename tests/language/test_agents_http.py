"""Over HTTP nobody gets in without the token, and no page of another origin does."""

from __future__ import annotations

import asyncio
import http.client
import json
import signal
import socket
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from starlette.types import Message, Receive, Scope, Send

from mcserver.cli.app import run_command_line
from mcserver.doors.listening import Address
from mcserver.errors import ConfigurationError
from mcserver.language.agents.http import AgentAccess, Guard, read_token
from tests.bench.server import free_port

TOKEN = "0123456789abcdef0123456789abcdef"
FAR = AgentAccess(Address("0.0.0.0", 8808), TOKEN, ("https://cell.example",))


async def _open_house(scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG001
    await send({"type": "http.response.start", "status": 200, "headers": []})


async def status(access: AgentAccess, *headers: tuple[bytes, bytes], kind: str = "http") -> int | None:
    sent: list[Message] = []

    async def receive() -> Message:
        return {}

    async def send(message: Message) -> None:
        sent.append(message)

    await Guard(_open_house, access)({"type": kind, "headers": list(headers)}, receive, send)
    return sent[0]["status"] if sent else None


BEARER = (b"authorization", f"Bearer {TOKEN}".encode())


@pytest.mark.parametrize(
    ("headers", "expected"),
    [
        ((), 401),
        (((b"authorization", b"Bearer "),), 401),
        (((b"authorization", TOKEN.encode()),), 401),
        (((b"authorization", f"Bearer {TOKEN[:-1]}".encode()),), 401),
        (((b"authorization", b"Bearer \xff\xfe"),), 401),
        ((BEARER, (b"authorization", b"Bearer other")), 401),
        ((BEARER,), 200),
        (((b"Authorization", BEARER[1]),), 200),
        ((BEARER, (b"origin", b"https://cell.example")), 200),
        ((BEARER, (b"origin", b"https://cell.example.evil")), 403),
        ((BEARER, (b"origin", b"null")), 403),
        ((BEARER, (b"origin", b"https://cell.example"), (b"origin", b"https://evil")), 403),
    ],
)
async def test_the_guard_lets_in_the_token_from_known_pages_alone(
    headers: tuple[tuple[bytes, bytes], ...], expected: int
) -> None:
    assert await status(FAR, *headers) == expected


async def test_the_guard_serves_no_web_socket() -> None:
    assert await status(FAR, BEARER, kind="websocket") is None


def test_other_addresses_need_the_token_and_tls(tmp_path: Path) -> None:
    pem = tmp_path / "site.pem"
    pem.write_text("a certificate")
    AgentAccess(Address("127.0.0.1", 1)).require_protection()
    AgentAccess(Address("0.0.0.0", 1, pem, pem), TOKEN).require_protection()
    for reached in (
        AgentAccess(Address("0.0.0.0", 1)),
        AgentAccess(Address("0.0.0.0", 1), TOKEN),
        AgentAccess(Address("::", 1, pem, pem)),
        AgentAccess(Address("127.0.0.1", 1, pem)),
    ):
        with pytest.raises(ConfigurationError, match="MC082"):
            reached.require_protection()


@pytest.mark.parametrize(
    ("content", "mode"),
    [
        (b"", 0o600),
        (b"short", 0o600),
        (b"two words of a token, and more", 0o600),
        (b"\xff" * 40, 0o600),
        (b"x" * 10_000, 0o600),
        (TOKEN.encode(), 0o644),
    ],
)
def test_a_token_file_that_does_not_do_is_refused(content: bytes, mode: int, tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_bytes(content)
    file.chmod(mode)
    with pytest.raises(ConfigurationError, match="MC082"):
        read_token(file)
    with pytest.raises(ConfigurationError, match="MC082"):
        read_token(tmp_path / "absent")


def test_the_command_does_not_start_unprotected() -> None:
    assert run_command_line(["mcp", "--http", "0.0.0.0:8808"]) == 3
    assert run_command_line(["mcp", "--token-file", "token"]) == 2


def initialize(port: int, host: str = "127.0.0.1", **headers: str) -> int:
    body: dict[str, Any] = {"jsonrpc": "2.0", "id": 1, "method": "initialize"}
    body["params"] = {
        "protocolVersion": "2025-06-18",
        "capabilities": {},
        "clientInfo": {"name": "test", "version": "1"},
    }
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=300)
    try:
        plain = {"Content-Type": "application/json", "Accept": "application/json, text/event-stream"}
        plain["Host"] = f"{host}:{port}"
        connection.request("POST", "/mcp", json.dumps(body), {**plain, **headers})
        return connection.getresponse().status
    finally:
        connection.close()


@asynccontextmanager
async def served(*options: str) -> AsyncIterator[int]:
    """The port of an agents' server in a process of its own."""
    port = free_port()
    command = [sys.executable, "-m", "mcserver", "mcp", "--http", f"127.0.0.1:{port}", *options]
    process = subprocess.Popen(command)
    try:
        for _ in range(600):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            await asyncio.sleep(0.1)
        yield port
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)


async def test_a_served_address_asks_for_its_token_host_and_origin(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text(TOKEN + "\n")
    file.chmod(0o600)
    async with served("--token-file", str(file)) as port:
        right = f"Bearer {TOKEN}"
        assert initialize(port) == 401
        assert initialize(port, Authorization="Bearer other") == 401
        assert initialize(port, Authorization=right) == 200
        assert initialize(port, Authorization=right, Origin="https://evil.example") == 403
        assert initialize(port, "evil.example", Authorization=right) == 421
