"""The menu in the header of each page: who is logged in, light or dark, messages of the browser, log out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from nicegui import ui

from mcserver.web.actions import show_refusal
from mcserver.web.sessions import Visitor

THEMES = {"system": "As the system", "light": "Light", "dark": "Dark"}
ANSWER_S = 60.0


def add_menu(visitor: Visitor) -> None:
    """Add the button and what it opens; choices belong to the browser, which keeps them."""
    with (
        ui.button(icon="menu").props('flat round dense color=white aria-label="Menu"'),
        ui.menu().props('anchor="bottom right" self="top right" :offset="[0, 12]"').classes("mc-menu"),
    ):
        _item(f"Logged in: {visitor.name}" if visitor.may_leave else "On this computer").props("disable")
        ui.separator()
        for theme, title in THEMES.items():
            _item(title, partial(ui.run_javascript, f"mcTheme('{theme}')"))
        ui.separator()
        _item("Tell me when it is done", _ask_for_messages)
        if visitor.may_leave:
            _item("Log out", partial(ui.run_javascript, "mcLeave()"))


def _item(title: str, act: Callable[[], object] | None = None) -> ui.menu_item:
    """Add an item; Quasar calls it that of a list, which a menu has none of."""
    return ui.menu_item(title, act).props("role=menuitem")


async def _ask_for_messages() -> None:
    try:
        answer = await ui.run_javascript("return await mcAskMessages()", timeout=ANSWER_S)
    except TimeoutError:
        return
    if answer == "granted":
        ui.notify("this browser says when a program is done or in alarm", position="bottom")
    else:
        show_refusal("The browser shows no messages", "allow them for this page in its settings")
