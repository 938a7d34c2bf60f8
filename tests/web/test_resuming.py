"""What goes to a browser that is slow, or whose link has just come back, without a browser."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from nicegui import Client, core, ui

from mcserver.web.resuming import BEHIND_S, LOST_S, ResumingOutbox


def made(clock: list[float]) -> tuple[Client, ResumingOutbox]:
    """Return a page whose outbox goes by a clock that stands; nothing is sent."""
    client = Client(ui.page("/resuming", reconnect_timeout=30.0))
    client.outbox.stop()
    client.outbox = outbox = ResumingOutbox(client, lambda: clock[0])
    outbox.stop()
    return client, outbox


def signs(outbox: ResumingOutbox) -> list[str]:
    """Return the signs of life that wait to be sent."""
    return [message["code"] for _, kind, message in outbox.messages if kind == "run_javascript"]


async def test_a_browser_is_behind_until_it_has_come_to_the_last_sign_of_life() -> None:
    clock = [100.0]
    client, outbox = made(clock)
    assert not outbox.is_behind
    outbox.send_sign_of_life()
    clock[0] += BEHIND_S
    assert not outbox.is_behind
    clock[0] += 0.01
    assert outbox.is_behind
    # another one would make what is old look new
    outbox.send_sign_of_life()
    outbox.on_confirmed(0)
    assert outbox.is_behind
    outbox.on_confirmed(1)
    assert not outbox.is_behind
    outbox.send_sign_of_life()
    assert signs(outbox) == ["mcAlive(1)", "mcAlive(2)"]
    # one that was never sent
    outbox.on_confirmed(7)
    outbox.send_sign_of_life()
    clock[0] += 1.0
    assert outbox.is_behind
    clock[0] += LOST_S
    outbox.send_sign_of_life()
    assert signs(outbox)[-1] == "mcAlive(4)"
    outbox.on_confirmed(4)
    assert not outbox.is_behind
    client.delete()


async def test_what_is_being_sent_as_the_link_comes_back_is_sent_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    client, outbox = made([0.0])
    going, sent = asyncio.Event(), []

    async def emit(kind: str, _: dict[str, Any], **__: object) -> None:
        sent.append(kind)
        await going.wait()

    monkeypatch.setattr(core.sio, "emit", emit)
    monkeypatch.setattr(core.app.config, "message_history_length", 0, raising=False)
    sending = asyncio.ensure_future(outbox._emit((client.id, "notify", {"message": "done"})))
    while not sent:
        await asyncio.sleep(0)
    # the browser has all that was sent before that
    outbox.try_rewind(outbox.next_message_id)
    going.set()
    await sending
    assert [(kind, content["message"]) for _, kind, content in outbox.messages] == [("notify", "done")]
    outbox.messages.clear()
    outbox.try_rewind(outbox.next_message_id)
    assert not outbox.messages
    client.delete()
