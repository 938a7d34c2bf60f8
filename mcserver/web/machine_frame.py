"""What every page of one machine has: its state and the emergency stop above, and a place at the machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from nicegui import events, ui

from mcserver.web.actions import Actions
from mcserver.web.formatting import banner
from mcserver.web.link import MachineLink
from mcserver.web.menu import add_menu
from mcserver.web.translation import t


class StateLabel:
    """The machine's state as a word in its colour."""

    def __init__(self) -> None:
        self._label = ui.label("…").classes("mc-state").props("role=status aria-live=polite")

    def update(self, link: MachineLink) -> str:
        """Show the newest state; return its word, untranslated."""
        word, kind = banner(link.status, link.online)
        if self._label.text != t(word):
            self._label.set_text(t(word))
            self._label.classes(replace=f"mc-state mc-state-{kind}")
        return word


@contextmanager
def header(actions: Actions) -> Iterator[None]:
    """Add the bar above a page: what is built inside, then the menu and the emergency stop."""
    with ui.header(elevated=True).classes("items-center justify-between no-wrap py-1 px-2 bg-slate-900"):
        with ui.row().classes("items-center gap-2"):
            yield
        with ui.row().classes("items-center no-wrap gap-0"):
            add_menu(actions.visitor)
            ui.button(t("E-STOP"), on_click=actions.emergency_stop).props(
                f'color=negative aria-label="{t("Emergency stop")}" data-estop'
            ).classes("mc-estop")


def obey_keys(actions: Actions) -> None:
    """Let Shift+Escape be the emergency stop, and Space outside a field a feed hold."""

    async def obey(event: events.GenericEventArguments) -> None:
        if event.args.get("key") == "estop":
            await actions.emergency_stop()
        else:
            await actions.hold()

    ui.on("mc_key", obey)


class Presence:
    """A browser's place at a machine, for as long as it shows the page; who only asks for it takes none.

    Args:
        on_leave: called where nobody looks at the page any more.
    """

    def __init__(self, actions: Actions, on_leave: Callable[[], None] = lambda: None) -> None:
        self._actions = actions
        self._link = actions.link
        self._on_leave = on_leave
        self._is_there = False
        client = ui.context.client
        client.on_connect(self._enter)
        # a connection that a newer one has replaced may end after that has come
        client.on_disconnect(lambda: None if client.has_socket_connection else self._cut(client.id))
        client.on_delete(self._leave)

    def _enter(self) -> None:
        self._link.control.come(self._actions.driver)
        if self._link.closed:
            # others needed its place while nobody looked
            ui.navigate.reload()
        elif not self._is_there:
            self._is_there = True
            self._link.enter(self._actions.visitor.name)

    def _cut(self, browser: str) -> None:
        self._link.control.leave(browser)
        self._leave()

    def _leave(self) -> None:
        if self._is_there:
            self._is_there = False
            self._link.leave(self._actions.visitor.name)
        self._on_leave()
