"""The machine file: seen and changed by an engineer, checked, its difference shown before it is written."""

from __future__ import annotations

import difflib
import html
from collections.abc import Sequence

from mcclient import Machine, MotionError
from mcclient.types import Diagnostic, MachineFileReply
from nicegui import ui

from mcserver.web.actions import Actions, show_error
from mcserver.web.dialogs import NamedDialog
from mcserver.web.formatting import diagnostics_html
from mcserver.web.panels.card import card
from mcserver.web.translation import mark, t

RESTART = mark("The server goes by it when it is restarted: systemctl restart mcserver.")
# checking solves tools and programs [s]
DEADLINE_S = 60.0


class MachineFilePanel:
    """A button that opens the file in a dialog; for engineers alone."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        with card(t("Machine file")) as shown:
            ui.button(t("Look at the machine file"), on_click=self._open).props("outline no-caps")
        shown.set_visibility(actions.visitor.may("machine_file"))

    async def _open(self) -> None:
        if not self._actions.has_role("machine_file"):
            return
        try:
            found = await self._actions.link.connected().machine_file()
        except MotionError as error:
            show_error(error)
            return
        dialog = NamedDialog(t("Machine file {name}", name=found.name)).props("maximized")
        with dialog, ui.card().classes("mc-card"):
            with ui.row().classes("w-full items-center justify-between"):
                ui.label(found.name).classes("font-bold grow break-all")
                ui.button(t("Close"), on_click=dialog.close).props("flat")
            MachineFileEditor(self._actions, found)
        dialog.on("hide", dialog.delete)
        dialog.open()


class MachineFileEditor:
    """The text, what its check says, how it differs, and the button that writes it."""

    def __init__(self, actions: Actions, found: MachineFileReply) -> None:
        self._actions = actions
        self._found = found
        self._state = ui.label(
            "" if found.in_force else f"{t('It has changed since the start.')} {t(RESTART)}"
        )
        self._text = (
            ui.textarea(label=t("Machine file"), value=found.text, on_change=self._changed)
            .classes("w-full font-mono")
            .props('input-style="min-height: 45vh" spellcheck=false outlined')
        )
        with ui.element("div").classes("mc-buttons"):
            ui.button(t("Check"), on_click=self._check).props("outline")
            self._write = ui.button(t("Write"), on_click=self._write_it).props("color=warning")
        self._report = ui.html("", sanitize=False).classes("w-full").props("role=status")
        self._write.set_enabled(False)

    def _changed(self) -> None:
        """What was checked is another text now."""
        self._write.set_enabled(False)

    async def _check(self) -> None:
        text = self._text.value
        if await self._ask(mark("check the machine file"), text, only_check=True):
            self._write.set_enabled(self._text.value == text != self._found.text)

    async def _write_it(self) -> None:
        text = self._text.value
        if await self._ask(mark("write the machine file"), text, only_check=False):
            self._write.set_enabled(False)

    async def _ask(self, name: str, text: str, *, only_check: bool) -> bool:
        """Have a text checked, and written; whether it has no error."""
        ok = False

        async def ask(machine: Machine) -> None:
            nonlocal ok
            found, by = self._found, self._actions.driver.name
            reply = await machine.write_machine_file(
                text, found.sha256, only_check=only_check, by=by, deadline_s=DEADLINE_S
            )
            ok = all(each.severity != "error" for each in reply.diagnostics)
            self._report.set_content(faults_html(reply.diagnostics) + difference_html(found.text, text))
            if reply.written:
                self._found = await machine.machine_file()
                self._state.set_text(
                    f"{t('Written; the one before is {name}.', name=reply.before)} {t(RESTART)}"
                )

        return await self._actions.do("write_machine_file", name, ask) and ok


def faults_html(diagnostics: Sequence[Diagnostic]) -> str:
    """Return what a check has found, each at its line."""
    if not diagnostics:
        return f"<p>{t('The check finds nothing wrong.')}</p>"
    return diagnostics_html(diagnostics)


def difference_html(before: str, after: str) -> str:
    """Return what is taken out and what is added, with two lines about each."""
    lines = list(difflib.unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=2))[2:]
    if not lines:
        return f"<p>{t('No line differs from the file.')}</p>"
    title = t("What changes")
    shown = "".join(f"<span class=mark>{html.escape(line) or ' '}</span>" for line in lines)
    return f"<p><b>{title}</b></p><pre class=mc-program tabindex=0 aria-label='{title}'>{shown}</pre>"
