"""Inputs and outputs: their values, and a button for each that can be set by hand."""

from __future__ import annotations

from functools import partial

from mcclient import Info, InputInfo, InputStatus, MachineStatus, OutputInfo
from nicegui import ui

from mcserver.web.actions import Actions
from mcserver.web.formatting import channel_text
from mcserver.web.panels.card import card
from mcserver.web.translation import mark, t


class ChannelsPanel:
    """One row an input or output; built anew when the machine's change, hidden where it has none."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._known: tuple[InputInfo | OutputInfo, ...] = ()
        self._values: list[ui.label] = []
        self._states: list[ui.label] = []
        self._levels: dict[str, float] = {}
        with card(t("Inputs and outputs")) as self._card:
            self._rows = ui.element("div").classes(
                "w-full grid grid-cols-[1fr_auto_auto] gap-x-3 gap-y-1 items-center"
            )
        self._card.set_visibility(False)

    def update(self, status: MachineStatus, info: Info) -> None:
        known: tuple[InputInfo | OutputInfo, ...] = (*info.inputs, *info.outputs)
        if known != self._known:
            self._build(known)
        states = [(each.value, _interlock(each)) for each in status.inputs]
        names = {each.program: each.name for each in status.programs}
        states += [(each.value, names.get(each.set_by) or each.set_by) for each in status.outputs]
        for channel, (value, state), shown, note in zip(
            known, states, self._values, self._states, strict=False
        ):
            self._levels[channel.name] = value
            shown.set_text(channel_text(channel.kind, value, channel.unit))
            note.set_text(state)

    def _build(self, known: tuple[InputInfo | OutputInfo, ...]) -> None:
        self._known = known
        self._values, self._states = [], []
        self._card.set_visibility(bool(known))
        self._rows.clear()
        with self._rows:
            for channel in known:
                with ui.row().classes("gap-2 items-baseline"):
                    ui.label(channel.name)
                    self._states.append(ui.label("").classes("text-xs text-slate-500"))
                self._values.append(ui.label("").classes("font-mono"))
                is_output = isinstance(channel, OutputInfo)
                settable = isinstance(channel, OutputInfo) or not channel.source
                if channel.kind == "digital" and settable:
                    ui.button(t("switch"), on_click=partial(self._switch, channel.name, is_output)).props(
                        f'outline dense aria-label="{t("switch {name}", name=channel.name)}"'
                    )
                else:
                    ui.label("")

    async def _switch(self, name: str, is_output: bool) -> None:
        value = not self._levels.get(name, 0.0)
        word = mark("{name} on", name=name) if value else mark("{name} off", name=name)
        if is_output:
            await self._actions.do("set_output", word, lambda machine: machine.set_output(name, value))
        else:
            await self._actions.do(
                "set_simulated_input", word, lambda machine: machine.set_simulated_input(name, value)
            )


def _interlock(status: InputStatus) -> str:
    if status.stops:
        return t("stops the machine")
    return t("holds the programs") if status.holds else ""
