"""The commissioning desk of a machine's drives, for engineers: what `mcserver drives` says, as a page."""

from __future__ import annotations

from urllib.parse import quote

from nicegui import ui

from mcserver.web.actions import Actions, role_text
from mcserver.web.control import Driver
from mcserver.web.link import MachineLink
from mcserver.web.machine_frame import Presence, StateLabel, header, obey_keys
from mcserver.web.panels.control import ControlPanel
from mcserver.web.panels.desk_bus import BusPanel
from mcserver.web.panels.desk_drive import DeskDrive
from mcserver.web.panels.desk_files import FilesPanel
from mcserver.web.panels.desk_mapped import MappedPanel
from mcserver.web.panels.desk_parameters import ParametersPanel
from mcserver.web.panels.desk_scope import ScopePanel
from mcserver.web.panels.desk_tune import TunePanel
from mcserver.web.panels.desk_units import UnitsPanel
from mcserver.web.panels.drives import DrivesPanel
from mcserver.web.panels.machine_file import MachineFilePanel
from mcserver.web.resuming import outbox_of
from mcserver.web.sessions import Visitor
from mcserver.web.translation import t

REFRESH_S = 0.25
# between two questions to the server [s]
SLOW_S = 1.0
# what only engineers may call
METHOD = "sdo_write"


class DeskPage:
    """Built once for each browser that opens it."""

    def __init__(self, visitor: Visitor, link: MachineLink) -> None:
        self._link = link
        client = ui.context.client
        actions = Actions(Driver(client.id, visitor), link)
        with header(actions):
            ui.link(link.name, f"/machine/{quote(link.name)}").classes("text-white font-bold")
            self._state = StateLabel()
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
                    MappedPanel(actions, self._drive)
                    BusPanel(actions)
                with ui.element("div").classes("mc-column"):
                    FilesPanel(self._drive)
                    UnitsPanel(self._drive)
                    TunePanel(actions, self._drive)
                    MachineFilePanel(actions)
                    self._drives = DrivesPanel(link)
        obey_keys(actions)
        refresh = {REFRESH_S: self.update, SLOW_S: self.ask}
        outbox_of(client).timer.start(lambda: visitor.may(METHOD), refresh)
        Presence(actions, self._stop)

    def update(self) -> None:
        """Show the newest state."""
        self._state.update(self._link)
        self._control.update()
        self._drive.update()
        self._scope.update()

    async def ask(self) -> None:
        """Refresh what the server is asked for."""
        machine = self._link.machine
        if machine is not None:
            await self._drive.look(machine)
            await self._drives.update(machine.info)

    def _stop(self) -> None:
        self._scope.stop()
        self._drive.stop()
