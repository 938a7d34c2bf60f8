"""The machine file's own buttons: each shows its program before it runs, and runs it as any program."""

from __future__ import annotations

from functools import partial

from mcclient import Info, MotionError
from mcclient.types import ButtonInfo
from nicegui import ui

from mcserver.machine.button_section import filled
from mcserver.net.roles import CONFIGURERS, MOVERS, roles_named
from mcserver.web.actions import Actions, show_error, show_refusal
from mcserver.web.dialogs import NamedDialog, answer_to
from mcserver.web.panels.card import card
from mcserver.web.translation import t


class ButtonsPanel:
    """A card for each group; none on machines without buttons."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._shown: tuple[ButtonInfo, ...] = ()
        self._cards = ui.element("div").classes("mc-place")
        self._cards.set_visibility(False)

    def update(self, info: Info) -> None:
        if info.buttons == self._shown:
            return
        self._shown = info.buttons
        self._cards.set_visibility(bool(info.buttons))
        self._cards.clear()
        groups = dict.fromkeys(each.group for each in info.buttons)
        with self._cards:
            for group in groups:
                with card(t(group) if group else t("Buttons")), ui.element("div").classes("mc-buttons"):
                    for each in info.buttons:
                        if each.group == group:
                            self._button(each)

    def _button(self, each: ButtonInfo) -> None:
        ui.button(f"{t(each.name)} …", on_click=partial(self._ask, each)).props("outline no-caps")

    async def _ask(self, button: ButtonInfo) -> None:
        if not self._may(button):
            return
        with NamedDialog(t("Run {name}", name=t(button.name))) as dialog, ui.card().classes("mc-ask"):
            ui.label(t(button.name)).classes("font-bold break-words")
            with ui.row().classes("w-full gap-x-4 gap-y-1"):
                fields = {
                    each.name: ui.number(
                        f"{t(each.name)} [{each.unit}]".removesuffix(" []"), value=each.first, format="%g"
                    )
                    .props(f'hint="{each.low:g} … {each.high:g}"')
                    .classes("w-32")
                    for each in button.arguments
                }
            text = ui.label("").classes("mc-program w-full")
            text.props(f'aria-label="{t("Program text")}" aria-live=polite tabindex=0')
            agreed = ui.checkbox(button.confirm) if button.confirm else None
            with ui.element("div").classes("mc-buttons"):
                run = ui.button(t("Run"), on_click=lambda: dialog.submit(text.text)).props("color=positive")
                ui.button(t("Cancel"), on_click=lambda: dialog.submit(None)).props("flat")

            def show() -> None:
                wrong = wrong_number(button, {name: field.value for name, field in fields.items()})
                values = {name: float(field.value or 0.0) for name, field in fields.items()}
                text.set_text(wrong or filled(button.text, values).strip("\n"))
                run.set_enabled(not wrong and (agreed is None or bool(agreed.value)))

            for field in fields.values():
                field.on_value_change(show)
            if agreed is not None:
                agreed.on_value_change(show)
            show()

        async def run_it(chosen: str) -> bool:
            # the role may have been taken away while the dialog was open
            if not self._may(button):
                return False
            try:
                # what it sets is kept with this name
                name, user = button.name, self._actions.visitor.name
                self._actions.link.jobs.add_text(f"{name} by {user}", chosen, user)
            except MotionError as error:
                show_error(error)
                return False
            return True

        await answer_to(dialog, run_it)

    def _may(self, button: ButtonInfo) -> bool:
        roles = CONFIGURERS if button.role == "engineer" else MOVERS
        if not self._actions.visitor.has(roles):
            show_refusal(
                t("This needs the role {roles}", roles=roles_named(roles)), t("log in as somebody who has it")
            )
            return False
        return self._actions.allowed("open")


def wrong_number(button: ButtonInfo, values: dict[str, float | None]) -> str:
    """Return which number is missing or outside its limits; empty: all are right."""
    for each in button.arguments:
        value = values[each.name]
        if value is None or not each.low <= value <= each.high:
            return t(
                "{name}: give a number from {low:g} to {high:g} {unit}",
                name=t(each.name),
                low=each.low,
                high=each.high,
                unit=each.unit,
            ).rstrip()
    return ""
