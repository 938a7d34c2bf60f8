"""The Python SDK's stream plays the contract's sequences, without a network."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any, cast

import msgspec
import pytest
from mcclient import stream as stream_module
from mcclient.calls import Caller
from mcclient.errors import MotionError, RequestRefused
from mcclient.keys import Keys
from mcclient.stream import LineStream
from mcclient.transport import Arrived, Link
from mcclient.types import ContinueReply, ErrorReply, OpenReply
from mcclient.window import LineWindow
from mcclient.wire import decode

from tests.contract.vectors import names, read

TURNS = 20


class ScriptedServer:
    """Stands for link and caller: notes what the stream sends, and answers what the script says."""

    def __init__(self) -> None:
        self.sent: deque[dict[str, Any]] = deque()
        self.status: bytes | None = None
        self.asked = 0
        self._deliver: Callable[[Arrived], None] = lambda _: None
        self._verdicts: asyncio.Queue[dict[str, Any]] = asyncio.Queue()

    def subscribe(self, _key: str, deliver: Callable[[Arrived], None], **_: object) -> ScriptedServer:
        self._deliver = deliver
        return self

    def close(self) -> None:
        self._deliver = lambda _: None

    async def put(self, _key: str, payload: bytes) -> None:
        first, lines, rejections = msgspec.msgpack.decode(payload)
        self.sent.append({"first": first, "lines": lines, "rejections": rejections})

    async def call(self, method: str, fields: dict[str, Any], **_: object) -> bytes:
        if method == "submit":
            self.sent.append({key: fields[key] for key in ("first", "lines", "rejections")})
            answer = await self._verdicts.get()
            if "refused" in answer:
                raise refused(answer["refused"])
            return bytes.fromhex(answer["reply"]["bytes"])
        assert method == "programs"
        self.asked += 1
        if self.status is None:
            raise RequestRefused("MC503", "no such program", "")
        return msgspec.msgpack.encode({"programs": [msgspec.Raw(self.status)]})

    def acknowledge(self, message: dict[str, Any]) -> None:
        self._deliver(Arrived("", bytes.fromhex(message["bytes"]), False))

    def give_verdict(self, answer: dict[str, Any]) -> None:
        self._verdicts.put_nowait(answer)


def refused(message: dict[str, Any]) -> RequestRefused:
    error = decode(ErrorReply, bytes.fromhex(message["bytes"]))
    return RequestRefused(
        error.code, error.message, error.hint, details=error.details, diagnostics=error.diagnostics
    )


class Player:
    """Plays one sequence."""

    def __init__(self, sequence: dict[str, Any]) -> None:
        self.server = ScriptedServer()
        self._chunk_lines = sequence["chunk_lines"]
        self._steps = sequence["steps"]
        self._judging: asyncio.Task[int] | None = None
        self.stream: LineStream

    async def play(self) -> None:
        for number, step in enumerate(self._steps):
            ((what, value),) = step.items()
            try:
                result = getattr(self, what)(value)
                if isinstance(result, Awaitable):
                    await result
                await turns()
            except AssertionError as error:
                raise AssertionError(f"step {number}, {what}: {error}") from error
        await self.stream.stop()

    async def open(self, message: dict[str, Any]) -> None:
        await self._follow(decode(OpenReply, bytes.fromhex(message["bytes"])))

    async def continues(self, message: dict[str, Any]) -> None:
        await self._follow(decode(ContinueReply, bytes.fromhex(message["bytes"])))

    async def _follow(self, opened: OpenReply | ContinueReply) -> None:
        if hasattr(self, "stream"):
            await self.stream.stop()
        self.stream = LineStream(
            opened,
            link=cast(Link, self.server),
            keys=Keys("cell", "contract-1"),
            caller=cast(Caller, self.server),
            patience_s=5.0,
        )
        self.stream.window = LineWindow(opened.expected, opened.credit, chunk_lines=self._chunk_lines)

    async def give(self, lines: list[str]) -> None:
        self.stream.begin()
        for line in lines:
            await self.stream.give(line)

    def judge(self, line: str) -> None:
        self.stream.begin()
        self._judging = asyncio.get_running_loop().create_task(self.stream.submit(line))

    def sends(self, message: dict[str, Any]) -> None:
        assert self.server.sent, "nothing is sent"
        assert self.server.sent.popleft() == message

    def quiet(self, _: bool) -> None:
        assert not self.server.sent

    def lost(self, _: str) -> None:
        """Nothing arrives."""

    def answer(self, answer: dict[str, Any]) -> None:
        if self._judging is not None and not self._judging.done():
            self.server.give_verdict(answer)
        else:
            self.server.acknowledge(answer["ack"])

    def ack(self, message: dict[str, Any]) -> None:
        self.server.acknowledge(message)

    async def asked(self, message: dict[str, Any] | None) -> None:
        self.server.status = None if message is None else bytes.fromhex(message["bytes"])
        await self.stream.resynchronise()

    def closes(self, value: dict[str, Any]) -> None:
        assert self.stream.window.accepted == value["last"]
        self.stream.closed = True

    def knows(self, value: dict[str, Any]) -> None:
        stream = self.stream
        assert value == {"accepted": stream.window.accepted, "done": stream.done, "state": stream.state}

    async def fails(self, value: dict[str, Any]) -> None:
        error = await self._failure()
        assert error.code == value["code"]
        assert value.get("says", "") in error.message
        if "line" in value:
            assert (error.line, error.column) == (value["line"], value["column"])

    async def _failure(self) -> MotionError:
        judging, self._judging = self._judging, None
        try:
            async with asyncio.timeout(60.0):
                await (self.stream.accepted_all() if judging is None else judging)
                self.stream.raise_failure()
        except MotionError as error:
            return error
        raise AssertionError("nothing has failed")


async def turns() -> None:
    for _ in range(TURNS):
        await asyncio.sleep(0)


@pytest.mark.parametrize("name", names("sequences"))
async def test_a_sequence_goes_as_the_contract_says(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # a step that comes late is no silent server, which is asked where a step says so
    monkeypatch.setattr(stream_module, "FIRST_DOUBT_S", 3600.0)
    await Player(read(f"sequences/{name}.json")).play()
