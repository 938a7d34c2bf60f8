"""Teaching: poses of the tool are taken as lines of a program, edited, replayed and kept."""

from __future__ import annotations

from mcclient import MotionError
from nicegui import ui

from mcserver.errors import McError
from mcserver.web.actions import Actions, show_error, show_refusal
from mcserver.web.dialogs import ask
from mcserver.web.open_programs import refuse_open
from mcserver.web.panels.card import card
from mcserver.web.panels.tool_jog import ToolJogPanel, pose_of
from mcserver.web.tool_steps import opening_lines, pose_line
from mcserver.web.translation import mark, t

TAUGHT = "taught.gcode"
MOST_CHARACTERS = 200_000
WHY = mark("a pose is taken where the tool stands")


class TeachPanel:
    """A text that grows by a line for each pose; hidden where there is no tool.

    Args:
        jog: has the tool and its speed.
    """

    def __init__(self, actions: Actions, jog: ToolJogPanel) -> None:
        self._actions = actions
        self._jog = jog
        with card(t("Teach")) as self._card:
            self._text = ui.textarea(label=t("Taught program")).classes("w-full font-mono")
            self._text.props(f"autogrow maxlength={MOST_CHARACTERS} spellcheck=false data-kept=taught")
            with ui.element("div").classes("mc-buttons"):
                ui.button(t("Take pose"), on_click=self._take).props("color=primary")
                ui.button(t("Replay"), on_click=self._replay).props("color=positive")
                self._name = ui.input(t("Program name"), value=TAUGHT).classes("w-40")
                ui.button(t("Save as program"), on_click=self._save).props("outline")
        self._card.set_visibility(False)

    def update(self) -> None:
        self._card.set_visibility(self._jog.tool is not None)

    async def _take(self) -> None:
        tool = self._jog.tool
        if tool is None or not self._actions.has_role("open"):
            return
        try:
            status = await self._actions.link.connected().status()
            refuse_open(self._actions.link, status.programs, WHY)
            line = pose_line(tool, pose_of(status.tools, tool), self._jog.speed)
        except MotionError as error:
            show_error(error)
            return
        text = str(self._text.value or "").rstrip("\n")
        lines = [text] if text.strip() else opening_lines(tool)
        self._text.set_value("\n".join([*lines, line]) + "\n")

    def _replay(self) -> None:
        text = str(self._text.value or "")
        if not text.strip():
            show_refusal(t("Nothing has been taught"), t("press Take pose first"))
        elif self._actions.allowed("open"):
            try:
                self._actions.link.jobs.add_text(self._name.value or TAUGHT, text, self._actions.visitor.name)
            except MotionError as error:
                show_error(error)

    async def _save(self) -> None:
        name, text = str(self._name.value or ""), str(self._text.value or "")
        if not self._actions.has_role("open"):
            return
        store = self._actions.link.store

        async def keep() -> bool:
            try:
                store.write(name, text.encode("utf-8"))
            except McError as error:
                show_error(error)
                return False
            ui.notify(t("{name} is kept", name=name), position="bottom")
            return True

        try:
            known = store.has(name)
        except McError as error:
            show_error(error)
            return
        if known:
            question = t("{name} is kept already. Replace it?", name=name)
            await ask(question, t("Replace"), colour="warning", act=keep)
        else:
            await keep()
