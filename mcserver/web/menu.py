"""The menu in the header of each page: who is logged in, light or dark, messages of the browser, log out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from nicegui import ui

from mcserver.web.actions import show_refusal
from mcserver.web.sessions import Visitor
from mcserver.web.translation import LANGUAGES, mark, t

THEMES = {"system": mark("As the system"), "light": mark("Light"), "dark": mark("Dark")}
ANSWER_S = 60.0


def add_menu(visitor: Visitor) -> None:
    """Add the button and what it opens; choices belong to the browser, which keeps them."""
    with (
        ui.button(icon="menu").props(f'flat round dense color=white aria-label="{t("Menu")}"'),
        ui.menu().props('anchor="bottom right" self="top right" :offset="[0, 12]"').classes("mc-menu"),
    ):
        _item(
            t("Logged in: {name}", name=visitor.name) if visitor.may_leave else t("On this computer")
        ).props("disable")
        ui.separator()
        for theme, title in THEMES.items():
            _item(t(title), partial(ui.run_javascript, f"mcTheme('{theme}')"))
        ui.separator()
        for code, name in LANGUAGES.items():
            # each by its own name, for who cannot read the others
            _item(name, partial(ui.run_javascript, f"mcLanguage('{code}')")).props(f"lang={code}")
        ui.separator()
        _item(t("Tell me when it is done"), _ask_for_messages)
        if visitor.may_leave:
            _item(t("Log out"), partial(ui.run_javascript, "mcLeave()"))


def _item(title: str, act: Callable[[], object] | None = None) -> ui.menu_item:
    """Add an item; Quasar calls it that of a list, which a menu has none of."""
    return ui.menu_item(title, act).props("role=menuitem")


async def _ask_for_messages() -> None:
    try:
        answer = await ui.run_javascript("return await mcAskMessages()", timeout=ANSWER_S)
    except TimeoutError:
        return
    if answer == "granted":
        ui.notify(t("this browser says when a program is done or in alarm"), position="bottom")
    else:
        show_refusal(t("The browser shows no messages"), t("allow them for this page in its settings"))
