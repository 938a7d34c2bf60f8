"""Dialogs that change something, without a browser."""

from __future__ import annotations

import asyncio

from nicegui import Client, ui

from mcserver.web.delays import event_delay_s
from mcserver.web.dialogs import NamedDialog, answer_to, ask


def dialog_with(value: str = "") -> tuple[NamedDialog, ui.input]:
    """Return a dialog with a field on a page of its own."""
    with Client(ui.page("/dialogs")), NamedDialog("Set it") as dialog:
        return dialog, ui.input(value=value)


async def turns() -> None:
    for _ in range(4):
        await asyncio.sleep(0)


async def test_a_dialog_stays_with_what_is_typed_until_it_is_done_and_acts_as_late_as_its_press() -> None:
    refused, seen = True, []

    async def act(answer: str) -> bool:
        seen.append((answer, event_delay_s.get()))
        return not refused

    dialog, field = dialog_with("12.5")
    answer = asyncio.ensure_future(answer_to(dialog, act))
    await turns()
    event_delay_s.set(9.0)
    dialog.submit(field.value)
    await turns()
    assert (dialog.value, dialog.is_deleted, field.value) == (True, False, "12.5")
    refused = False
    event_delay_s.set(0.5)
    dialog.submit(field.value)
    assert await answer == "12.5"
    assert dialog.is_deleted
    assert seen == [("12.5", 9.0), ("12.5", 0.5)]


async def test_what_is_pressed_while_it_is_being_done_is_not_done_again() -> None:
    going, count = asyncio.Event(), 0

    async def act(_: bool) -> bool:
        nonlocal count
        count += 1
        await going.wait()
        return False

    dialog, _ = dialog_with()
    answer = asyncio.ensure_future(answer_to(dialog, act))
    await turns()
    for _ in range(2):
        dialog.submit(True)
        await turns()
    going.set()
    await turns()
    dialog.close()
    assert await answer is None
    assert (count, dialog.is_deleted) == (1, True)


async def test_a_dialog_that_is_closed_while_it_is_being_done_is_gone_afterwards() -> None:
    going = asyncio.Event()

    async def act(_: bool) -> bool:
        await going.wait()
        return False

    dialog, _ = dialog_with()
    answer = asyncio.ensure_future(answer_to(dialog, act))
    await turns()
    dialog.submit(True)
    await turns()
    dialog.close()
    going.set()
    assert await answer is None
    assert dialog.is_deleted


async def test_who_cancels_while_it_is_being_done_stops_it() -> None:
    stopped = asyncio.Event()
    client = Client(ui.page("/dialogs"))

    async def act() -> bool:
        await stopped.wait()
        return True

    async def asked() -> bool:
        with client:
            return await ask("Restore?", "Restore", colour="warning", act=act, stop=stopped.set)

    answer = asyncio.ensure_future(asked())
    await turns()
    buttons = {each.text: each for each in client.elements.values() if isinstance(each, ui.button)}
    press(buttons["Restore"])
    await turns()
    assert buttons["Restore"].props["loading"]
    press(buttons["Cancel"])
    assert await answer


def press(button: ui.button) -> None:
    """Press as a browser's message does."""
    (listener,) = button._event_listeners
    button._handle_event({"listener_id": listener, "args": []})
