"""A scope of every object that is mapped: by the bus of the chosen drive, as the server listens to it."""

from __future__ import annotations

import numpy as np
from mcclient import MotionError
from mcclient.types import DriveTrace
from nicegui import ui

from mcserver.canopen.scope import ScopeTrace
from mcserver.errors import McError
from mcserver.web.actions import Actions, show_error
from mcserver.web.panels.card import card
from mcserver.web.panels.desk_drive import DeskDrive
from mcserver.web.panels.traces import download_trace, draw_trace, span_choice
from mcserver.web.translation import t

TIMEOUT_S = 30.0


class MappedPanel:
    """What `mcserver drives scope` records; a trace stays until the next one, or another drive."""

    def __init__(self, actions: Actions, drive: DeskDrive) -> None:
        self._actions = actions
        self._drive = drive
        self._trace: ScopeTrace | None = None
        self._trigger_unix = 0.0
        with card(t("Mapped objects")):
            with ui.row().classes("w-full items-center gap-2"):
                self._trigger = (
                    ui.input(t("Trigger by an object"), placeholder="6064 > 10")
                    .props("dense")
                    .classes("grow min-w-28 basis-40")
                )
                self._span = span_choice()
            with ui.element("div").classes("mc-buttons"):
                self._button = ui.button(t("Record"), on_click=self._record).props("color=primary")
                self._save = ui.button(t("Download the trace"), on_click=self._download).props("outline")
            self._said = ui.label("").classes("text-sm break-words").props("role=status")
            self._curves = (
                ui.select({}, value=[], multiple=True, label=t("Curves"), on_change=self._draw)
                .props("use-chips dense")
                .classes("w-full")
            )
            self._chart = ui.echart({}).classes("mc-chart")
        self._clear()
        drive.on_change(self._clear)

    def _clear(self) -> None:
        self._trace = None
        self._said.set_text("")
        self._save.set_enabled(False)
        self._curves.set_visibility(False)
        self._chart.set_visibility(False)

    async def _record(self) -> None:
        drive = self._drive.chosen()
        if drive is None or not self._actions.has_role("drive_scope"):
            return
        trigger = str(self._trigger.value or "").strip()
        self._clear()
        self._said.set_text(t("waits for the trigger") if trigger else t("recording"))
        self._button.set_enabled(False)
        try:
            found = await self._actions.link.connected().drive_scope(
                drive.axis, seconds=self._span.value, trigger=trigger, timeout_s=TIMEOUT_S
            )
        except (MotionError, McError) as error:
            self._said.set_text(f"{t(error.message)} [{error.code}]")
            show_error(error)
            return
        finally:
            self._button.set_enabled(True)
        if self._drive.drive is drive:
            self._show(found)

    def _show(self, found: DriveTrace) -> None:
        self._trace, self._trigger_unix = trace_of(found), found.trigger_unix
        fewer = t("{count} cycles were lost on the way", count=found.missing) if found.missing else ""
        self._said.set_text("; ".join(filter(None, [t("{count} cycles", count=found.cycles), fewer])))
        names = {
            at: " ".join(filter(None, [place, name]))
            for at, (place, name) in enumerate(zip(self._trace.objects, self._trace.names, strict=True))
        }
        units, columns = self._trace.units, self._trace.values.T
        moved = [at for at, column in enumerate(columns) if units[at] and np.isfinite(column).any()][:3]
        for element in (self._curves, self._chart):
            element.set_visibility(True)
        self._save.set_enabled(True)
        self._curves.set_options(names, value=moved or list(names)[:1])
        self._draw()

    def _draw(self) -> None:
        trace = self._trace
        if trace is None:
            return
        columns = sorted(self._curves.value)
        # those without a unit have a picture each: bits and codes are no lengths
        units = [trace.units[at] or trace.objects[at] for at in columns]
        draw_trace(self._chart, trace, columns, [trace.names[at] for at in columns], units)

    def _download(self) -> None:
        if self._trace is not None:
            download_trace(self._trace, self._actions.link.name, self._trigger_unix, "-mapped")


def trace_of(found: DriveTrace) -> ScopeTrace:
    """Return a trace as a server has sent it."""
    signals = found.signals
    return ScopeTrace(
        found.axis,
        tuple(each.name for each in signals),
        tuple(each.unit for each in signals),
        tuple(each.object for each in signals),
        found.begin_s + np.arange(found.cycles, dtype=np.float64) * found.cycle_s,
        np.stack([np.frombuffer(each.values, "<f8") for each in signals], axis=1),
    )
