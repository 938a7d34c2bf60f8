"""A planner that is being started again is expected: the machine's heartbeat does not stop for it."""

from __future__ import annotations

import asyncio
import itertools
import socket
from collections.abc import Callable, Sequence
from types import SimpleNamespace

import msgspec
import pytest

from mcserver.planning import client
from mcserver.planning.client import START_TIMEOUT_S, PlannerProcess
from mcserver.planning.message_pipe import MessagePipe
from mcserver.planning.planner_messages import (
    Begin,
    Dropped,
    PipelineRequest,
    PlannerCommand,
    PlannerEvent,
    PlannerFailed,
    Validated,
)
from mcserver.planning.start_state import StartState

LIMIT_S = 5.0


class FakeChild:
    """A planner's process of which only the pipe is there; ``theirs`` is its end."""

    def __init__(self, *, plain: bool = False) -> None:
        self.plain = plain
        ours, theirs = socket.socketpair()
        self.pipe = MessagePipe(ours)
        self.theirs = MessagePipe(theirs)

    def ending(self) -> str:
        return "was ended by signal 9"

    def stop(self) -> None:
        self.pipe.close()


async def until(holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(LIMIT_S):
        while not holds():
            await asyncio.sleep(0)


async def test_a_planner_that_is_started_again_may_be_silent_until_it_is_ready(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = SimpleNamespace(now=1000.0)
    monkeypatch.setattr(client, "time", SimpleNamespace(monotonic=lambda: clock.now))
    children = [FakeChild(), FakeChild()]
    first, second = children
    events: list[PlannerEvent] = []

    def on_events(more: Sequence[PlannerEvent]) -> None:
        events.extend(more)

    planner = PlannerProcess(first, lambda: second, on_events)  # type: ignore[arg-type, return-value]
    planner.start()
    clock.now += 10.0
    assert planner.last_seen == 1000.0, "one that runs has to be heard of"
    first.theirs.close()
    await until(lambda: planner._child is second and bool(events))
    assert isinstance(events[0], PlannerFailed)
    clock.now += 100.0
    assert planner.last_seen == clock.now, "its start is longer than any silence that is allowed"
    second.theirs.send(msgspec.msgpack.encode([]))
    await until(lambda: planner._heard_at == clock.now)
    heard = clock.now
    clock.now += 10.0
    assert planner.last_seen == heard, "from its first word on it has to be heard of"
    second.theirs.close()
    await planner.stop()


async def test_a_planner_without_machine_code_may_think_for_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(now=1000.0)
    monkeypatch.setattr(client, "time", SimpleNamespace(monotonic=lambda: clock.now))
    child = FakeChild(plain=True)
    planner = PlannerProcess(child, lambda: child, lambda _: None)  # type: ignore[arg-type, return-value]
    planner.start()
    clock.now += 20.0
    assert planner.last_seen == clock.now
    clock.now += 20.0
    assert planner.last_seen == 1000.0 + client.PLAIN_SILENCE_S, "it has to be heard of, too"
    child.theirs.close()
    await planner.stop()


async def test_a_planner_that_never_gets_ready_is_not_waited_for_without_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = SimpleNamespace(now=1000.0)
    monkeypatch.setattr(client, "time", SimpleNamespace(monotonic=lambda: clock.now))
    first, second = FakeChild(), FakeChild()
    planner = PlannerProcess(first, lambda: second, lambda _: None)  # type: ignore[arg-type, return-value]
    planner.start()
    first.theirs.close()
    await until(lambda: planner._child is second)
    clock.now += START_TIMEOUT_S + 1.0
    assert planner.last_seen == 1000.0
    second.theirs.close()
    await planner.stop()


async def test_a_planner_that_is_given_up_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(now=1000.0)
    monkeypatch.setattr(client, "time", SimpleNamespace(monotonic=lambda: clock.now))
    children = [FakeChild() for _ in range(client.MOST_STARTS + 1)]
    left = iter(children[1:])
    planner = PlannerProcess(children[0], lambda: next(left), lambda _: None)  # type: ignore[arg-type, return-value]
    planner.start()
    for ended, following in itertools.pairwise(children):
        ended.theirs.close()
        await until(lambda following=following: planner._child is following)  # type: ignore[misc]
    children[-1].theirs.close()
    await until(lambda: planner._phase is client.ConnectionPhase.ENDED)
    clock.now += 10.0
    assert planner.last_seen < clock.now, "the server's heartbeat has to stop"
    await planner.stop()


async def test_a_planner_without_machine_code_makes_room_for_one_that_has_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kept = False
    monkeypatch.setattr(client, "COMPILED_LOOK_S", 0.0)
    monkeypatch.setattr(client, "kernels_kept", lambda: kept)
    plain, compiled = FakeChild(plain=True), FakeChild()
    events: list[PlannerEvent] = []
    planner = PlannerProcess(plain, lambda: compiled, events.extend)  # type: ignore[arg-type, return-value]
    planner.start()
    planner.send(begin("a-1"))
    kept = True
    for _ in range(20):
        await asyncio.sleep(0.001)
    assert len(received(plain)) == 1, "a program is planned to its end by who has begun it"
    plain.theirs.send(msgspec.msgpack.encode([Dropped("a-1")]))
    told: list[bytes] = []
    await until(lambda: bool(told.extend(received(plain)) or told))
    assert told == [b""]
    planner.send(begin("a-2"))
    plain.theirs.send(msgspec.msgpack.encode([Validated("a-1", 1, 2.0)]))
    plain.theirs.close()
    await until(lambda: planner._child is compiled and bool(told.extend(received(compiled)) or len(told) > 1))
    assert msgspec.msgpack.decode(told[1], type=PlannerCommand) == begin("a-2")
    assert events == [Dropped("a-1"), Validated("a-1", 1, 2.0)], "nothing has failed, and nothing is lost"
    compiled.theirs.close()
    await planner.stop()


async def test_a_planner_without_machine_code_ends_with_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "COMPILED_LOOK_S", 0.0)
    monkeypatch.setattr(client, "kernels_kept", lambda: True)
    plain = FakeChild(plain=True)
    planner = PlannerProcess(plain, lambda: pytest.fail("started"), lambda _: None)  # type: ignore[arg-type]
    planner.start()
    await until(lambda: received(plain) == [b""])
    await planner.stop()
    with pytest.raises(EOFError):
        plain.theirs.receive()
    plain.theirs.close()


def begin(program: str) -> Begin:
    return Begin(PipelineRequest(program, frozenset({0}), StartState({})), 0, False, 0.0)


def received(child: FakeChild) -> list[bytes]:
    """Commands that have come to a child."""
    return child.theirs.receive()
