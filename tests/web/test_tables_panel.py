"""The card of work offsets and tools, without a browser."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

from mcclient import Info, MotionError
from mcclient.types import Tables
from nicegui import Client, ui

from mcserver.web.actions import Actions
from mcserver.web.panels.tables import TablesPanel
from mcserver.web.shared_answers import SharedAnswers

INFO = cast("Info", SimpleNamespace(axes=()))


def panel_of(ask: Callable[[], Any]) -> TablesPanel:
    """Return the card of a machine whose tables are asked for by ``ask``."""
    link = SimpleNamespace(
        has_work_offsets=True,
        machine=SimpleNamespace(tables=ask),
        status=SimpleNamespace(programs=()),
        answers=SharedAnswers(time.monotonic),
    )
    return TablesPanel(cast("Actions", SimpleNamespace(link=link)))


def buttons_of(client: Client) -> list[ui.button]:
    return [each for each in client.elements.values() if isinstance(each, ui.button)]


async def test_a_button_is_not_seen_before_the_tables_are_there_that_it_changes() -> None:
    answer: asyncio.Future[Tables] = asyncio.get_running_loop().create_future()
    with Client(ui.page("/tables")) as client:
        panel = panel_of(lambda: answer)
        update = asyncio.ensure_future(panel.update(INFO))
        await asyncio.sleep(0)
        (card,) = (each for each in client.elements.values() if isinstance(each, ui.card))
        assert not card.visible
        answer.set_result(Tables(offsets=(), tool_table=False, tools=(), changes=()))
        await update
        assert card.visible
        assert buttons_of(client)[0].enabled


async def test_what_cannot_be_changed_now_cannot_be_pressed() -> None:
    async def refuse() -> Tables:
        raise MotionError("MC530", "no answer")

    with Client(ui.page("/tables")) as client:
        await panel_of(refuse).update(INFO)
        assert not any(each.enabled for each in buttons_of(client))
