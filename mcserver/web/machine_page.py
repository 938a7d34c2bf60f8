"""The page of one machine."""

from __future__ import annotations

import json

from mcclient import Machine, MachineStatus
from mcclient.broken_off import ENERGIZE
from nicegui import ui

from mcserver.web.actions import Actions
from mcserver.web.announcements import Announcer, title_of
from mcserver.web.control import Driver
from mcserver.web.formatting import current_program
from mcserver.web.link import MachineLink
from mcserver.web.machine_frame import Presence, StateLabel, header, obey_keys
from mcserver.web.open_programs import run_at_rest
from mcserver.web.panels.arming import ArmingPanel
from mcserver.web.panels.buttons import ButtonsPanel
from mcserver.web.panels.camera import CameraPanel
from mcserver.web.panels.channels import ChannelsPanel
from mcserver.web.panels.charts import ChartPanel
from mcserver.web.panels.control import ControlPanel
from mcserver.web.panels.drives import DrivesPanel
from mcserver.web.panels.held_buttons import HeldButtons
from mcserver.web.panels.homing import HomingPanel
from mcserver.web.panels.jog import JogPanel
from mcserver.web.panels.machine_file import MachineFilePanel
from mcserver.web.panels.mdi import MdiPanel
from mcserver.web.panels.messages import EventPanel, FaultPanel
from mcserver.web.panels.notices import NoticePanel
from mcserver.web.panels.past import PastPanel
from mcserver.web.panels.people import PeoplePanel
from mcserver.web.panels.picture import PicturePanel
from mcserver.web.panels.positions import PositionsPanel
from mcserver.web.panels.program import ProgramPanel
from mcserver.web.panels.recordings import RecordingsPanel
from mcserver.web.panels.run_from import RecoveryPanel
from mcserver.web.panels.tables import TablesPanel
from mcserver.web.panels.teach import TeachPanel
from mcserver.web.panels.tool_jog import ToolJogPanel
from mcserver.web.past import Past
from mcserver.web.resuming import outbox_of
from mcserver.web.sessions import Visitor
from mcserver.web.translation import mark, t

REFRESH_S = 0.1
# positions, at the most: they are shown as they come
FOLLOW_S = 0.01
# charts, pictures and lists, in refreshes: drawing them is what costs a phone its battery
SLOW_EVERY = 4
# between two questions to the server [s]
SLOW_S = 1.0
# a message of what has ended stays this long [ms]
MESSAGE_MS = 15_000
WHY = mark("energizing would wait for its end")
OVERRIDES = (10, 25, 50, 75, 100, 125, 150, 200)


class MachinePage:
    """Built once for each browser that opens it; refreshed from the machine's one shared state."""

    def __init__(self, visitor: Visitor, link: MachineLink, past: Past | None) -> None:
        self._link = link
        client = ui.context.client
        self._actions = actions = Actions(Driver(client.id, visitor), link)
        self._announcer = Announcer(link.name)
        self._turn = 0
        self._title = ""
        self._stale: bool | None = None
        with header(actions):
            ui.link(t("Fleet"), "/").classes("text-white")
            ui.label(link.name).classes("font-bold")
            self._state = StateLabel()
            self._late = ui.label("").classes("text-xs mc-late")
        self._held = HeldButtons(actions)
        with ui.element("div").classes("w-full p-2"):
            ui.html(f"<h1 class='sr-only'>{link.name}</h1>", sanitize=False)
            with ui.element("div").classes("mc-grid"):
                # the numbers are the order on a narrow screen, where all of it is one column
                with ui.element("div").classes("mc-column"):
                    with _place(0):
                        self._notices = NoticePanel(link)
                    with _place(1):
                        self._faults = FaultPanel(actions)
                    with _place(1):
                        self._recovery = RecoveryPanel(actions)
                    with _place(2):
                        self._arming = ArmingPanel(actions)
                    with _place(3):
                        self._controls()
                    with _place(6):
                        self._buttons = ButtonsPanel(actions)
                    with _place(6):
                        self._program = ProgramPanel(actions, self._recovery)
                    with _place(11):
                        self._recordings = RecordingsPanel(actions)
                with ui.element("div").classes("mc-column"):
                    with _place(5):
                        self._positions = PositionsPanel(actions)
                    with _place(4):
                        self._jog = JogPanel(actions, self._held)
                    with _place(4):
                        self._tool_jog = ToolJogPanel(actions, self._held)
                    with _place(5):
                        self._teach = TeachPanel(actions, self._tool_jog)
                    with _place(7):
                        self._tables = TablesPanel(actions)
                    with _place(8):
                        MdiPanel(actions)
                    with _place(9):
                        self._homing = HomingPanel(actions)
                    with _place(10):
                        self._channels = ChannelsPanel(actions)
                    with _place(13):
                        self._drives = DrivesPanel(link, desk=visitor.may("sdo_write"))
                    with _place(17):
                        MachineFilePanel(actions)
                with ui.element("div").classes("mc-column"):
                    with _place(7):
                        self._picture = PicturePanel(link)
                    with _place(7):
                        self._camera = CameraPanel(link)
                    with _place(12):
                        self._chart = ChartPanel(link)
                    with _place(14):
                        self._people = PeoplePanel(link)
                    with _place(15):
                        self._events = EventPanel(link)
                    if past is not None:
                        with _place(16):
                            PastPanel(link, past)
        obey_keys(actions)
        if not visitor.may("open"):
            client.on_connect(lambda: ui.run_javascript("mcWatchOnly()"))
        refresh = {REFRESH_S: self.update, SLOW_S: self.ask, FOLLOW_S: self._follow}
        outbox_of(client).timer.start(visitor.is_known, refresh)
        client.on_disconnect(self._held.release)
        client.on_disconnect(self._tool_jog.drop)
        Presence(actions)
        self.update()

    async def _follow(self) -> None:
        """Show where the axes are as soon as the server says it, not at the next refresh."""
        await self._link.next_status()
        if self._link.machine is not None:
            self._positions.update(self._link.machine.info)

    async def ask(self) -> None:
        """Refresh what the server is asked for, not what it says by itself."""
        machine = self._link.machine
        if machine is not None:
            await self._recovery.update()
            await self._recordings.update()
            await self._drives.update(machine.info)
            await self._tables.update(machine.info)

    def _controls(self) -> None:
        do = self._actions.do
        with ui.card().classes("mc-card"):
            with ui.element("div").classes("mc-buttons"):
                ui.button(t("Hold"), on_click=self._actions.hold).props("color=warning data-stop")
                ui.button(
                    t("Resume"),
                    on_click=lambda: do("resume", mark("resume"), lambda machine: machine.resume()),
                ).props("color=positive")
                ui.button(t("Abort"), on_click=self._actions.abort).props("color=negative outline data-stop")
                ui.button(t("Energize"), on_click=self._energize).props("outline")
            self._control = ControlPanel(self._actions)
            self._override_label = ui.label("").classes("font-bold mt-2")
            with ui.element("div").classes("mc-buttons"):
                for percent in OVERRIDES:
                    ui.button(f"{percent} %", on_click=lambda percent=percent: self._override(percent)).props(
                        "outline dense"
                    )
                ui.button("−5", on_click=lambda: self._override_by(-5)).props("outline dense data-often")
                ui.button("+5", on_click=lambda: self._override_by(5)).props("outline dense data-often")

    async def _override(self, percent: float) -> None:
        await self._actions.do(
            "override",
            mark("override {percent:g} %", percent=percent),
            lambda machine: machine.override(percent),
        )

    async def _override_by(self, step: float) -> None:
        status = self._link.status
        if status is not None:
            await self._override(min(200.0, max(0.0, status.override + step)))

    async def _energize(self) -> None:
        async def capture(machine: Machine) -> None:
            await run_at_rest(self._link, machine, ENERGIZE, "G1010", WHY)

        await self._actions.do("open", mark("energize"), capture)

    def update(self) -> None:
        """Show the newest state."""
        status, machine = self._link.status, self._link.machine
        word = self._state.update(self._link)
        self._control.update()
        self._notices.update(status)
        self._say(status, word)
        if status is None or machine is None:
            return
        self._late.set_text(t("{count} late cycles", count=status.late_cycles))
        self._positions.update(machine.info)
        self._jog.update(machine.info)
        self._tool_jog.update(machine.info)
        self._teach.update()
        self._buttons.update(machine.info)
        self._channels.update(status, machine.info)
        self._faults.update(status)
        self._override_label.set_text(t("Override {override:.0f} %", override=status.override))
        if self._turn % SLOW_EVERY == 0:
            self._program.update()
            self._picture.update(status)
            self._arming.update()
            self._chart.update(status, machine.info)
            self._homing.update(status, machine.info)
            self._camera.update(machine.info)
            self._people.update()
            self._events.update()
        self._turn += 1

    def _say(self, status: MachineStatus | None, word: str) -> None:
        """Say in the tab, and in messages, what somebody should know who does not look."""
        stale = not self._link.online
        if stale is not self._stale:
            self._stale = stale
            ui.run_javascript(f"document.body.classList.toggle('mc-offline', {json.dumps(stale)})")
        title = title_of(self._link.name, word, None if stale else current_program(status))
        if title != self._title:
            self._title = title
            ui.page_title(title)
        if status is None or stale:
            return
        for kind, head, text, is_alarm in self._announcer.update(status, self._link.jobs.programs()):
            # an alarm has a card of its own. Below: above are the buttons that stop, on a phone
            if not is_alarm:
                ui.notify(text, type=kind, position="bottom", close_button=t("close"), timeout=MESSAGE_MS)
            ui.run_javascript(f"mcTell({json.dumps(head)}, {json.dumps(text)})")


def _place(order: int) -> ui.element:
    """Return where a card goes."""
    return ui.element("div").classes("mc-place").style(f"order: {order}")
