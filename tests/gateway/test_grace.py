"""How long a session outlives its connection, without a network and without waiting."""

from __future__ import annotations

import asyncio
from typing import Any, cast

import msgspec
import pytest
from starlette.websockets import WebSocket, WebSocketDisconnect

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
        self.grace_s = websocket.GRACE_S
        self.there: list[bool] = []

    @classmethod
    async def open(cls, *_: object) -> FakeSession:
        return cls()

    def end_subscriptions(self) -> None:
        self.outbox.clear()

    def back(self) -> None:
        self.there.append(True)

    def away(self) -> None:
        self.there.append(False)

    async def leave(self) -> None:
        self.there.clear()

    async def close(self) -> None:
        self.closed = True


class FakeSocket:
    """A connection that a test breaks."""

    def __init__(self, secret: str = "") -> None:
        self.headers = {"sec-websocket-protocol": "mc.v1"}
        self.query_params = {"session": secret}
        self.client = None
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


class GoneSocket(FakeSocket):
    """A connection whose other end is gone: closing it says so, as Starlette does."""

    async def close(self, *_: object) -> None:
        raise WebSocketDisconnect(1006)


class StuckSocket(FakeSocket):
    """A connection that takes nothing any more, not even its end."""

    async def send_bytes(self, _: bytes) -> None:
        await asyncio.Event().wait()

    async def close(self, *_: object) -> None:
        await asyncio.Event().wait()


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


@pytest.mark.parametrize("kind", [GoneSocket, StuckSocket])
async def test_a_connection_that_cannot_be_closed_does_not_keep_the_next_one_out(
    monkeypatch: pytest.MonkeyPatch, kind: type[FakeSocket]
) -> None:
    monkeypatch.setattr(websocket, "GatewaySession", FakeSession)
    monkeypatch.setattr(websocket, "CLOSE_S", 0.0)
    sessions = Sessions(None, (), None, frozenset())
    old, new = kind(), FakeSocket("secret")
    first = asyncio.ensure_future(sessions.serve(cast(WebSocket, old)))
    await turns()
    second = asyncio.ensure_future(sessions.serve(cast(WebSocket, new)))
    await first
    await turns()
    assert new.hello["resumed"] is True
    new.break_link()
    await second
    await sessions.close()


async def test_of_two_that_take_a_session_up_at_once_one_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(websocket, "GatewaySession", FakeSession)
    sessions = Sessions(None, (), None, frozenset())
    old, *others = FakeSocket(), FakeSocket("secret"), FakeSocket("secret")
    serving = [asyncio.ensure_future(sessions.serve(cast(WebSocket, old)))]
    await turns()
    serving += [asyncio.ensure_future(sessions.serve(cast(WebSocket, each))) for each in others]
    await turns()
    assert [task.done() for task in serving] == [True, True, False]
    others[1].break_link()
    await asyncio.gather(*serving)
    await sessions.close()
