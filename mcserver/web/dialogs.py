"""Dialogs: each has a name for who cannot see it, and is gone from the page once it is closed.

One that changes something stays, with what is typed in it, until that is done: where it is refused, came too
late or has no answer, it can be sent again.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from mcserver.web.delays import event_delay_s
from mcserver.web.translation import t


class NamedDialog(ui.dialog):
    """A dialog that a screen reader announces by name."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.props["aria-label"] = name
        self._answer: Any = None
        self._delay_s = 0.0

    def submit(self, result: Any) -> None:
        """Answer."""
        self._answer, self._delay_s = result, event_delay_s.get()
        self.submitted.set()

    async def next_answer(self) -> Any:
        """Wait for what is submitted; None: the dialog was closed, or its page.

        What is done next is as late as the answer was, not as what has opened the dialog.
        """
        self._answer = None
        # what was pressed while the answer before was dealt with is dropped
        self.submitted.clear()
        if self.value and not self.is_deleted:
            await self.submitted.wait()
        event_delay_s.set(self._delay_s)
        return self._answer


def answers(dialog: NamedDialog, verb: str, colour: str = "primary") -> None:
    """Add the two buttons below what is asked: True is submitted, or False."""
    with ui.element("div").classes("mc-buttons"):
        ui.button(verb, on_click=lambda: dialog.submit(True)).props(f"color={colour}")
        ui.button(t("Cancel"), on_click=lambda: dialog.submit(False)).props("flat")


async def answer_to(dialog: NamedDialog, act: Callable[[Any], Awaitable[bool]]) -> Any:
    """Open a dialog, and wait for what is submitted: None where it was closed, or its page. It is gone then.

    Args:
        act: does what an answer asks for; whether it was done. Where not the dialog stays.
    """
    dialog.open()
    answer = await dialog.next_answer()
    while answer is not None and answer is not False and not await act(answer):
        answer = await dialog.next_answer()
    if not dialog.is_deleted:
        dialog.delete()
    return answer


async def ask(
    question: str,
    verb: str,
    *,
    colour: str,
    act: Callable[[], Awaitable[bool]],
    stop: Callable[[], object] = lambda: None,
    details: Callable[[], object] | None = None,
) -> bool:
    """Ask before something is done, and do it; whether it was done.

    Args:
        verb: on the button that does it. colour: of that button. act: does it; whether it was done. Where not
            the question stays. stop: ends it early, for who cancels meanwhile.
        details: builds what is shown below the question.
    """
    with NamedDialog(question) as dialog, ui.card().classes("mc-ask"):
        ui.label(question).classes("font-bold break-words")
        if details is not None:
            details()
        with ui.element("div").classes("mc-buttons"):
            do = ui.button(verb, on_click=lambda: dialog.submit(True)).props(f"color={colour}")
            ui.button(t("Cancel"), on_click=lambda: cancel()).props("flat autofocus")

    def cancel() -> None:
        dialog.close()
        stop()

    async def acting(_: bool) -> bool:
        do.props("loading")
        try:
            return await act()
        finally:
            do.props(remove="loading")

    return bool(await answer_to(dialog, acting))
