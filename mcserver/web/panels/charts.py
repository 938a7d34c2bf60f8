"""Charts of any signals over the last seconds, with one cursor through all of them."""

from __future__ import annotations

import json

from mcclient import Info, MachineStatus
from nicegui import ui

from mcserver.web.link import HISTORY_S, MachineLink
from mcserver.web.panels.card import card
from mcserver.web.signals import signals_of, value_of
from mcserver.web.translation import t

SPANS_S = (10, 30, 60, HISTORY_S)
MOST_SIGNALS = 12


class ChartPanel:
    """One chart for each unit; every sample is sent once, and kept by the browser."""

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        self._info: Info | None = None
        self._known: dict[str, tuple[str, str]] = {}
        self._shown: tuple[object, ...] = ()
        self._sent_until: tuple[str, float] = ("", 0.0)
        with card(t("Signals")):
            with ui.row().classes("w-full items-center"):
                self._choice = (
                    ui.select({}, value=[], multiple=True, with_input=True, label=t("Signals"))
                    .props("use-chips dense")
                    .classes("grow basis-64")
                )
                self._span = ui.select(
                    {each: f"{each} s" for each in SPANS_S}, value=30, label=t("Span")
                ).classes("w-24")
                self._freeze = ui.switch(t("Freeze"), on_change=self._on_freeze)
            self._chart = ui.echart({}).classes("mc-chart")

    def _on_freeze(self) -> None:
        ui.run_javascript(f"mcChartFrozen({self._chart.id}, {json.dumps(self._freeze.value)})")

    def update(self, status: MachineStatus, info: Info) -> None:
        if info is not self._info:
            self._info = info
            self._known = known = signals_of(info)
            names = {key: f"{name} [{unit}]" for key, (name, unit) in known.items()}
            self._choice.set_options(names, value=[f"axis {axis.index} velocity" for axis in info.axes[:3]])
        known = self._known
        if self._freeze.value:
            return
        chosen = [key for key in self._choice.value if key in known][:MOST_SIGNALS]
        shown = (tuple(chosen), self._span.value, status.instance)
        restart = shown != self._shown
        since = ("", 0.0) if restart else self._sent_until
        rows: list[list[float | None]] = []
        for state in reversed(self._link.history):
            if (state.instance, state.t) == since or state.instance != status.instance:
                break
            if state.t < status.t - self._span.value:
                break
            values = (value_of(state, key) for key in chosen)
            rounded = (None if value is None else round(value, 5) for value in values)
            rows.append([round(state.t, 3), *rounded])
        self._shown, self._sent_until = shown, (status.instance, status.t)
        if not rows and not restart:
            return
        message = {
            "names": [known[key][0] for key in chosen],
            "units": [known[key][1] for key in chosen],
            "steps": [known[key][1] == t("on/off") for key in chosen],
            "span": self._span.value,
            "rows": rows[::-1],
            "restart": restart,
        }
        ui.run_javascript(f"mcChart({self._chart.id}, {json.dumps(message)})")
