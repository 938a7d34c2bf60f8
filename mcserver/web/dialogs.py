"""Dialogs: each has a name for who cannot see it, and is gone from the page once it is closed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from mcserver.web.delays import event_delay_s
from mcserver.web.translation import t


class NamedDialog(ui.dialog):
    """A dialog that a screen reader announces by name.

    Attributes:
        delay_s: how late the answer was [s].
    """

    def __init__(self, name: str) -> None:
        super().__init__()
        self.props["aria-label"] = name
        self.delay_s = 0.0

    def submit(self, result: Any) -> None:
        """Answer."""
        self.delay_s = event_delay_s.get()
        super().submit(result)


async def answer_to(dialog: NamedDialog) -> Any:
    """Wait for what is submitted: None where the dialog was closed, or its page. It is gone afterwards.

    What is done next is as late as the answer was, not as what has opened the dialog.
    """
    answer = await dialog
    event_delay_s.set(dialog.delay_s)
    if not dialog.is_deleted:
        dialog.delete()
    return answer


async def ask(question: str, verb: str, *, colour: str, details: Callable[[], object] | None = None) -> bool:
    """Ask before something is done; whether it shall be.

    Args:
        verb: on the button that does it. colour: of that button. details: builds what is shown below the
            question.
    """
    with NamedDialog(question) as dialog, ui.card().classes("mc-ask"):
        ui.label(question).classes("font-bold break-words")
        if details is not None:
            details()
        with ui.element("div").classes("mc-buttons"):
            ui.button(verb, on_click=lambda: dialog.submit(True)).props(f"color={colour}")
            ui.button(t("Cancel"), on_click=lambda: dialog.submit(False)).props("flat autofocus")
    return bool(await answer_to(dialog))


async def ask_to_replace(name: str) -> bool:
    """Ask before a kept program gets another text; whether it shall."""
    return await ask(t("{name} is kept already. Replace it?", name=name), t("Replace"), colour="warning")
