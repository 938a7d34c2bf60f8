"""What goes to a browser whose link has just come back, without a browser."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from nicegui import Client, core, ui

from mcserver.web.resuming import ResumingOutbox


async def test_what_is_being_sent_as_the_link_comes_back_is_sent_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    client = Client(ui.page("/resuming", reconnect_timeout=30.0))
    client.outbox.stop()
    client.outbox = outbox = ResumingOutbox(client)
    outbox.stop()
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
