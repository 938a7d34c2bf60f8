"""Messages to other programs; the receivers are functions."""

from __future__ import annotations

import asyncio
import dataclasses
import hashlib
import hmac
import json
import logging
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest
from mcclient import Event, MotionError
from mcclient.types import EventsReply, Fault

from mcserver.errors import ConfigurationError
from mcserver.web.fleet_events import FleetEvents
from mcserver.web.webhooks import ATTEMPTS, MAX_WAITING, Hook, HookSection, Receiver, read_hooks

SECRET = b"correct horse battery"
URL = "https://example.org/hook/TOKEN"
FAULT = Event(seq=4, t=2.5, instance="i1", kind="fault", fault=Fault(code="MC407", message="error", axis=2))
FINISHED = Event(seq=5, t=3.0, instance="i1", kind="program.ended", program="p-1", state="finished")


class Rig:
    """A receiver that answers as the test says, on a clock that passes by sleeping."""

    def __init__(self, answer: Callable[[httpx.Request], httpx.Response], **section: object) -> None:
        self.requests: list[httpx.Request] = []
        self.slept: list[float] = []

        def handle(request: httpx.Request) -> httpx.Response:
            self.requests.append(request)
            return answer(request)

        client = httpx.AsyncClient(transport=httpx.MockTransport(handle))
        hook = Hook(HookSection(URL, **section), SECRET, "https://example.org")  # type: ignore[arg-type]
        self.receiver = Receiver(hook, client, lambda: 1_700_000_000.0 + sum(self.slept), self._sleep)

    async def _sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        await asyncio.sleep(0)

    async def settle(self) -> None:
        running = asyncio.ensure_future(self.receiver.run())
        async with asyncio.timeout(20.0):
            while self.receiver._waiting:
                await asyncio.sleep(0)
        running.cancel()


def ok(_: httpx.Request) -> httpx.Response:
    return httpx.Response(204)


async def test_a_message_is_signed_and_says_what_happened() -> None:
    rig = Rig(ok)
    rig.receiver.take("cell-1", FAULT)
    await rig.settle()
    (request,) = rig.requests
    stamp = request.headers["X-MC-Timestamp"]
    expected = hmac.new(SECRET, stamp.encode() + b"." + request.content, hashlib.sha256).hexdigest()
    assert request.headers["X-MC-Signature"] == f"sha256={expected}"
    assert (request.headers["X-MC-Event"], request.headers["X-MC-Delivery"]) == ("fault", "i1-4")
    body = json.loads(request.content)
    assert (body["machine"], body["event"], body["fault"]["code"], body["fault"]["axis"]) == (
        "cell-1",
        "fault",
        "MC407",
        2,
    )


async def test_a_program_whose_server_was_killed_is_told_of_by_default() -> None:
    rig = Rig(ok)
    rig.receiver.take("cell-1", dataclasses.replace(FINISHED, state="interrupted"))
    await rig.settle()
    (request,) = rig.requests
    assert json.loads(request.content)["event"] == "interrupted"


async def test_only_what_is_wanted_is_sent() -> None:
    rig = Rig(ok, events=("finished",), machines=("cell-*",))
    for machine, event in (("cell-1", FAULT), ("other", FINISHED), ("cell-2", FINISHED)):
        rig.receiver.take(machine, event)
    await rig.settle()
    assert [json.loads(request.content)["machine"] for request in rig.requests] == ["cell-2"]


async def test_a_receiver_that_is_down_is_tried_again_with_growing_pauses_and_then_given_up() -> None:
    rig = Rig(lambda _: httpx.Response(503))
    rig.receiver.take("m", FAULT)
    await rig.settle()
    assert len(rig.requests) == ATTEMPTS
    assert rig.slept == [1.0, 4.0, 16.0, 60.0, 60.0]
    assert (rig.receiver.delivered, rig.receiver.failed) == (0, 1)
    # the delivery keeps its id, so that a receiver knows it again
    assert len({request.headers["X-MC-Delivery"] for request in rig.requests}) == 1


async def test_a_refusal_is_not_repeated() -> None:
    rig = Rig(lambda _: httpx.Response(401))
    rig.receiver.take("m", FAULT)
    await rig.settle()
    assert len(rig.requests) == 1


async def test_a_redirect_is_not_followed() -> None:
    rig = Rig(lambda _: httpx.Response(302, headers={"Location": "http://169.254.169.254/"}))
    rig.receiver.take("m", FAULT)
    await rig.settle()
    assert [str(request.url) for request in rig.requests] == [URL]


async def test_what_waits_is_bounded() -> None:
    rig = Rig(ok)
    for _ in range(MAX_WAITING + 25):
        rig.receiver.take("m", FAULT)
    assert rig.receiver.dropped == 25
    await rig.settle()
    assert rig.receiver.delivered == MAX_WAITING


async def test_neither_secret_nor_address_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    def fail(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError(f"cannot connect to {request.url}")

    with caplog.at_level(logging.WARNING):
        rig = Rig(fail)
        rig.receiver.take("m", FAULT)
        await rig.settle()
    assert "MC067" in caplog.text
    assert "TOKEN" not in caplog.text
    assert SECRET.decode() not in caplog.text + repr(rig.receiver._hook)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[[webhook]]",
        '[[webhook]]\nurl = "ftp://x"\nsecret_env = "HOOK"',
        '[[webhook]]\nurl = "https://user:pw@x/"\nsecret_env = "HOOK"',
        '[[webhook]]\nurl = "https://x/"',
        '[[webhook]]\nurl = "https://x/"\nsecret_env = "SHORT"',
        '[[webhook]]\nurl = "https://x/"\nsecret_file = "none"',
        '[[webhook]]\nurl = "https://x/"\nsecret_env = "HOOK"\nevents = ["everything"]',
        '[[webhook]]\nurl = "https://x/"\nsecret_env = "HOOK"\nunknown = 1',
        "not toml [",
    ],
)
def test_a_file_that_cannot_be_meant_is_refused(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOOK", SECRET.decode())
    monkeypatch.setenv("SHORT", "pw")
    file = tmp_path / "hooks.toml"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match="MC066"):
        read_hooks(file)


def test_the_secret_comes_from_a_file_or_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOOK", SECRET.decode())
    (tmp_path / "secret").write_text("another long secret\n")
    file = tmp_path / "hooks.toml"
    file.write_text(
        f'[[webhook]]\nurl = "{URL}"\nsecret_env = "HOOK"\n'
        '[[webhook]]\nurl = "http://127.0.0.1:8000/"\nsecret_file = "secret"\n'
    )
    first, second = read_hooks(file)
    assert (first.secret, second.secret) == (SECRET, b"another long secret")
    assert first.name == "https://example.org"


class FakeFleet:
    """Machines with their events; as their servers tell them."""

    def __init__(self) -> None:
        self.machines: dict[str, tuple[str, list[Event]]] = {}

    async def find(self, *, timeout_s: float) -> list[str]:  # noqa: ARG002
        return sorted(self.machines)

    async def events(self, machine: str, since: int, limit: int = 1000) -> EventsReply:
        instance, events = self.machines[machine]
        if not events:
            raise MotionError("MC532", "no answer")
        found = [event for event in events if event.seq >= since][:limit]
        return EventsReply(instance, events[0].seq, events[-1].seq, found)

    def happen(self, machine: str, instance: str, *numbers: int) -> None:
        kept = self.machines.get(machine, ("", []))
        events = kept[1] if kept[0] == instance else []
        new = [Event(seq=number, t=0.0, instance=instance, kind="reset") for number in numbers]
        self.machines[machine] = (instance, events + new)


async def test_events_are_read_once_from_where_one_came_in() -> None:
    fleet = FakeFleet()
    fleet.happen("a", "i1", 1, 2, 3)
    events = FleetEvents(history=False)
    assert await events.poll(fleet, 1.0) == []
    fleet.happen("a", "i1", 4)
    fleet.happen("b", "j1", 1)
    assert [(name, event.seq) for name, event in await events.poll(fleet, 1.0)] == [("a", 4), ("b", 1)]
    assert await events.poll(fleet, 1.0) == []


async def test_what_happens_while_there_is_no_link_is_read_by_the_next_one() -> None:
    fleet, events = FakeFleet(), FleetEvents(history=False)
    fleet.happen("a", "i1", 1)
    assert await events.poll(fleet, 1.0) == []
    fleet.happen("a", "i1", 2)
    another = FakeFleet()
    another.machines = fleet.machines
    assert [event.seq for _, event in await events.poll(another, 1.0)] == [2]


async def test_another_start_of_a_server_counts_anew() -> None:
    fleet = FakeFleet()
    fleet.happen("a", "i1", 1, 2, 3)
    events = FleetEvents(history=True)
    assert len(await events.poll(fleet, 1.0)) == 3
    fleet.happen("a", "i2", 1)
    assert [event.instance for _, event in await events.poll(fleet, 1.0)] == ["i2"]
    fleet.happen("a", "i2", 2)
    assert [event.seq for _, event in await events.poll(fleet, 1.0)] == [2]


async def test_a_machine_that_does_not_answer_holds_up_nobody() -> None:
    fleet = FakeFleet()
    fleet.happen("a", "i1", 1)
    fleet.machines["mute"] = ("k", [])
    events = FleetEvents(history=True)
    assert [name for name, _ in await events.poll(fleet, 1.0)] == ["a"]
