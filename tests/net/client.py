"""A plain Zenoh client for tests, which writes the wire by hand."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable
from typing import Any

import msgspec
import zenoh

from tests.zenoh_sessions import opened

LIMIT_S = 5.0


class ErrorAnswer(Exception):
    """A `reply_err`."""

    def __init__(self, body: dict[str, Any]) -> None:
        super().__init__(f"{body['code']}: {body['message']}")
        self.body = body
        self.code: str = body["code"]


class WireClient:
    """Raw queries, puts and subscriptions on one machine.

    Args:
        endpoint: of the server. machine: its name. client: this client's id.
    """

    def __init__(
        self,
        endpoint: str,
        machine: str,
        client: str = "tester",
        loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        self.session = opened(
            {"mode": "client", "connect/endpoints": [endpoint], "timestamping/enabled": True}
        )
        self.root = f"mc/@v1/{machine}"
        self.client = client
        self._numbers = itertools.count(1)
        self._loop = loop or asyncio.get_running_loop()

    async def ask(self, key: str, payload: object = None) -> list[Any]:
        """All replies to one query; raises the first error."""
        return await self.ask_raw(key, None if payload is None else msgspec.msgpack.encode(payload))

    async def ask_raw(self, key: str, payload: bytes | None) -> list[Any]:
        """As `ask`, with the bytes as they are."""
        ended = asyncio.Event()
        replies: list[zenoh.Reply] = []
        self.session.get(
            f"{self.root}/{key}" if not key.startswith("mc/") else key,
            zenoh.handlers.Callback(
                replies.append, lambda: self._loop.call_soon_threadsafe(ended.set), indirect=False
            ),
            payload=payload,
            consolidation=zenoh.ConsolidationMode.NONE,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
            timeout=LIMIT_S,
        )
        await asyncio.wait_for(ended.wait(), LIMIT_S + 1.0)
        answers = []
        for reply in replies:
            if reply.ok is None:
                raise ErrorAnswer(msgspec.msgpack.decode(reply.err.payload.to_bytes()))
            answers.append(msgspec.msgpack.decode(reply.ok.payload.to_bytes()))
        return answers

    async def call(self, method: str, *, request: int | None = None, **fields: object) -> Any:
        """One remote call with this client's id."""
        body = {"request": request or next(self._numbers), **fields}
        answers = await self.ask(self.method(method), body)
        assert len(answers) == 1, f"{method}: {len(answers)} answers"
        return answers[0]

    def method(self, name: str) -> str:
        """This client's key of a method."""
        return f"@rpc/{self.client}/{name}"

    def lines_key(self, program: str) -> str:
        """This client's key for lines of a program."""
        return f"in/{self.client}/{program}"

    def put(self, key: str, payload: object) -> None:
        self.session.put(f"{self.root}/{key}", msgspec.msgpack.encode(payload))

    def subscribe(self, key: str) -> Messages:
        """Everything that comes on ``key`` from now on."""
        messages = Messages(self._loop)
        self.session.declare_subscriber(
            f"{self.root}/{key}", zenoh.handlers.Callback(messages.push, indirect=False)
        )
        return messages

    async def close(self) -> None:
        await asyncio.to_thread(self.session.close)


class Messages:
    """What a subscription has brought, decoded."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.all: list[Any] = []
        self._loop = loop
        self._news = asyncio.Event()

    def push(self, sample: zenoh.Sample) -> None:
        if "*" in str(sample.key_expr):
            # somebody's put by a wildcard reaches every subscriber
            return
        self.all.append(msgspec.msgpack.decode(sample.payload.to_bytes()))
        self._loop.call_soon_threadsafe(self._news.set)

    async def first(self, wanted: Callable[[Any], bool] = lambda _: True) -> Any:
        """The first message that fits."""
        async with asyncio.timeout(LIMIT_S):
            while True:
                self._news.clear()
                for message in self.all:
                    if wanted(message):
                        return message
                await self._news.wait()
