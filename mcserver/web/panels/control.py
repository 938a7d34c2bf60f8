"""Who drives the machine, and the buttons to take control and to give it back."""

from __future__ import annotations

from nicegui import ui

from mcserver.web.actions import Actions
from mcserver.web.control import Control
from mcserver.web.dialogs import ask
from mcserver.web.translation import mark, t


class ControlPanel:
    """A row of the card of controls. It tells its visitor when somebody else has taken control."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._control: Control = actions.link.control
        self._had = False
        with ui.row().classes("items-center w-full gap-2 no-wrap"):
            self._who = ui.label("").classes("grow min-w-0 break-words").props("aria-live=polite")
            self._take = ui.button(t("Take control"), on_click=self._ask_for_it).props("outline no-caps")
            self._back = ui.button(t("Give back"), on_click=self._give_back).props("outline no-caps")
        self.update()

    def update(self) -> None:
        other = self._control.other(self._actions.driver.browser)
        mine = other is None and self._control.driver is not None
        self._who.set_text(
            t("You have control")
            if mine
            else t("Nobody has control")
            if other is None
            else t("{name} has control", name=other.name)
        )
        self._take.set_visibility(not mine)
        self._back.set_visibility(mine)
        if self._had and other is not None:
            ui.notify(
                t("{name} has taken control", name=other.name),
                type="warning",
                position="bottom",
                close_button=t("close"),
            )
        self._had = mine

    async def _ask_for_it(self) -> None:
        if not self._actions.has_role("open"):
            return
        other = self._control.other(self._actions.driver.browser)
        if other is None:
            await self._take_it()
            return
        await ask(
            t("{name} has control of {machine}. Take it?", name=other.name, machine=self._actions.link.name),
            t("Take control"),
            colour="warning",
            act=self._take_it,
        )

    async def _take_it(self) -> bool:
        # the role may have been taken away while the dialog was open
        if not self._actions.has_role("open"):
            return False
        self._actions.take_control()
        self.update()
        return True

    def _give_back(self) -> None:
        self._control.give_back(self._actions.driver.browser)
        self._had = False
        self._actions.note(mark("gives control back"))
        self.update()
