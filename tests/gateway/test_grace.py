"""How long a session outlives its connection, without a network and without waiting."""

from __future__ import annotations

import asyncio
from typing import Any, cast

import msgspec
import pytest
from starlette.websockets import WebSocket

from mcserver.gateway import websocket
from mcserver.gateway.session import Outbox
from mcserver.gateway.tokens import LOCAL
from mcserver.gateway.websocket import Sessions


class FakeSession:
    """What a connection needs of a session."""

    def __init__(self) -> None:
        self.client, self.secret, self.principal = "gw-1", "secret", LOCAL
        self.outbox = Outbox()
        self.connection: object | None = None
        self.closed = False

    @classmethod
    async def open(cls, *_: object) -> FakeSession:
        return cls()

    def end_subscriptions(self) -> None:
        self.outbox.clear()

    async def close(self) -> None:
        self.closed = True


class FakeSocket:
    """A connection that a test breaks."""

    def __init__(self, secret: str = "") -> None:
        self.headers = {"sec-websocket-protocol": "mc.v1"}
        self.query_params = {"session": secret}
        self.hello: dict[str, Any] = {}
        self._broken = asyncio.Event()

    async def accept(self, _: str) -> None:
        """Agree."""

    async def close(self, *_: object) -> None:
        self._broken.set()

    async def receive(self) -> dict[str, Any]:
        await self._broken.wait()
        return {"type": "websocket.disconnect"}

    async def send_bytes(self, frame: bytes) -> None:
        self.hello = msgspec.msgpack.decode(frame)

    def break_link(self) -> None:
        self._broken.set()


class Clock:
    """Stands for `asyncio.sleep`: who sleeps waits for the test."""

    def __init__(self) -> None:
        self._sleepers: list[asyncio.Future[None]] = []

    async def sleep(self, _: float) -> None:
        self._sleepers.append(asyncio.get_running_loop().create_future())
        await self._sleepers[-1]

    def wake_oldest(self) -> None:
        sleeper = self._sleepers.pop(0)
        if not sleeper.done():
            sleeper.set_result(None)


async def turns() -> None:
    for _ in range(20):
        future = asyncio.get_running_loop().create_future()
        asyncio.get_running_loop().call_soon(future.set_result, None)
        await future


async def test_the_grace_begins_anew_with_each_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(websocket, "GatewaySession", FakeSession)
    monkeypatch.setattr(asyncio, "sleep", clock.sleep)
    sessions = Sessions(None, (), None, frozenset())

    async def lose(socket: FakeSocket) -> None:
        serving = asyncio.ensure_future(sessions.serve(cast(WebSocket, socket)))
        await turns()
        socket.break_link()
        await serving
        await turns()

    first, second, third = FakeSocket(), FakeSocket("secret"), FakeSocket("secret")
    await lose(first)
    await lose(second)
    # the end of the grace that began with the first loss
    clock.wake_oldest()
    await turns()
    serving = asyncio.ensure_future(sessions.serve(cast(WebSocket, third)))
    await turns()
    assert third.hello["resumed"] is True
    third.break_link()
    await serving
    await sessions.close()
