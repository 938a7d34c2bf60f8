"""The commissioning desk of a machine's drives, for engineers: what `mcserver drives` says, as a page."""

from __future__ import annotations

from urllib.parse import quote

from nicegui import events, ui

from mcserver.web.actions import Actions, role_text
from mcserver.web.control import Driver
from mcserver.web.formatting import banner
from mcserver.web.link import MachineLink
from mcserver.web.menu import add_menu
from mcserver.web.panels.control import ControlPanel
from mcserver.web.panels.desk_bus import BusPanel
from mcserver.web.panels.desk_drive import DeskDrive
from mcserver.web.panels.desk_files import FilesPanel
from mcserver.web.panels.desk_parameters import ParametersPanel
from mcserver.web.panels.desk_scope import ScopePanel
from mcserver.web.panels.drives import DrivesPanel
from mcserver.web.sessions import Visitor
from mcserver.web.translation import mark, t

REFRESH_S = 0.25
# signs of life, and questions to the server, in refreshes
BEAT_EVERY = 4
# what only engineers may call
METHOD = "sdo_write"


class DeskPage:
    """Built once for each browser that opens it."""

    def __init__(self, visitor: Visitor, link: MachineLink) -> None:
        self._visitor = visitor
        self._link = link
        self._beat = 0
        # a browser is connected to this page; who only asks for it takes no place
        self._looking = False
        client = ui.context.client
        self._actions = actions = Actions(Driver(client.id, visitor), link)
        self._header()
        if not visitor.may(METHOD):
            ui.label(role_text(METHOD))
            return
        ui.page_title(t("{machine}: drives", machine=link.name))
        self._drive = DeskDrive(actions)
        with ui.element("div").classes("w-full p-2"):
            ui.html(f"<h1 class='sr-only'>{t('Commissioning desk')}</h1>", sanitize=False)
            with ui.element("div").classes("mc-grid"):
                with ui.element("div").classes("mc-column"):
                    with ui.card().classes("mc-card"):
                        self._control = ControlPanel(actions)
                        self._drive.build()
                    ParametersPanel(self._drive)
                with ui.element("div").classes("mc-column"):
                    self._scope = ScopePanel(actions)
                    BusPanel(actions)
                with ui.element("div").classes("mc-column"):
                    FilesPanel(self._drive)
                    self._drives = DrivesPanel(link)
        ui.on("mc_key", self._on_key)
        ui.timer(REFRESH_S, self.update)
        client.on_connect(self._enter)
        client.on_disconnect(lambda: None if client.has_socket_connection else self._cut(client.id))
        client.on_delete(self._leave)

    def _header(self) -> None:
        name = self._link.name
        with ui.header(elevated=True).classes("items-center justify-between no-wrap py-1 px-2 bg-slate-900"):
            with ui.row().classes("items-center gap-2"):
                ui.link(name, f"/machine/{quote(name)}").classes("text-white font-bold")
                self._state = ui.label("…").classes("mc-state").props("role=status aria-live=polite")
            with ui.row().classes("items-center no-wrap gap-0"):
                add_menu(self._visitor)
                ui.button(t("E-STOP"), on_click=self._actions.emergency_stop).props(
                    f'color=negative aria-label="{t("Emergency stop")}" data-estop'
                ).classes("mc-estop")

    async def update(self) -> None:
        """Show the newest state."""
        if self._beat % BEAT_EVERY == 0:
            ui.run_javascript("mcAlive()")
            if not self._visitor.is_known() or not self._visitor.may(METHOD):
                ui.navigate.reload()
                return
        self._beat += 1
        word, kind = banner(self._link.status, self._link.online)
        if self._state.text != t(word):
            self._state.set_text(t(word))
            self._state.classes(replace=f"mc-state mc-state-{kind}")
        self._control.update()
        self._drive.update()
        self._scope.update()
        if self._link.machine is not None and self._beat % BEAT_EVERY == 1:
            await self._drive.look()
            await self._drives.update(self._link.machine.info)

    async def _on_key(self, event: events.GenericEventArguments) -> None:
        if event.args.get("key") == "estop":
            await self._actions.emergency_stop()
        else:
            await self._actions.do("hold", mark("hold"), lambda machine: machine.hold())

    def _enter(self) -> None:
        self._link.control.come(self._actions.driver)
        if self._link.closed:
            # others needed its place while nobody looked
            ui.navigate.reload()
        elif not self._looking:
            self._looking = True
            self._link.enter(self._visitor.name)

    def _cut(self, browser: str) -> None:
        self._link.control.leave(browser)
        self._leave()

    def _leave(self) -> None:
        if self._looking:
            self._looking = False
            self._link.leave(self._visitor.name)
        self._scope.stop()
        self._drive.stop()
