"""A scope of every object that is mapped: by the bus of the chosen drive, as the server listens to it."""

from __future__ import annotations

import io
import json

import numpy as np
from mcclient import MotionError
from mcclient.types import DriveTrace
from nicegui import ui

from mcserver.canopen.scope import ScopeTrace
from mcserver.errors import McError
from mcserver.web.actions import Actions, show_error
from mcserver.web.panels.desk_drive import DeskDrive
from mcserver.web.sample_scope import drawn_rows
from mcserver.web.translation import t

SPANS_S = (0.5, 1.0, 2.0, 5.0, 10.0)
TIMEOUT_S = 30.0


class MappedPanel:
    """What `mcserver drives scope` records; a trace stays until the next one, or another drive."""

    def __init__(self, actions: Actions, drive: DeskDrive) -> None:
        self._actions = actions
        self._drive = drive
        self._trace: ScopeTrace | None = None
        self._trigger_unix = 0.0
        with ui.card().classes("mc-card"):
            ui.html(f"<h2>{t('Mapped objects')}</h2>", sanitize=False)
            with ui.row().classes("w-full items-center gap-2"):
                self._trigger = (
                    ui.input(t("Trigger by an object"), placeholder="6064 > 10")
                    .props("dense")
                    .classes("grow min-w-28 basis-40")
                )
                self._span = (
                    ui.select({each: f"{each:g} s" for each in SPANS_S}, value=2.0, label=t("Span"))
                    .props("dense")
                    .classes("w-20")
                )
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
        message = {
            "names": [trace.names[at] for at in columns],
            # those without a unit have a picture each: bits and codes are no lengths
            "units": [trace.units[at] or trace.objects[at] for at in columns],
            "steps": [False] * len(columns),
            "span": float(trace.time_s[-1] - trace.time_s[0]),
            "rows": drawn_rows(trace, columns),
            "restart": True,
            "zero": 0,
        }
        ui.run_javascript(f"mcChart({self._chart.id}, {json.dumps(message)})")

    def _download(self) -> None:
        if self._trace is None:
            return
        # Protobuf and MCAP are loaded when somebody wants a file
        from mcserver.recorder.scope_file import write_scope

        stream, name = io.BytesIO(), self._actions.link.name
        write_scope(stream, self._trace, name, self._trigger_unix)
        ui.download.content(stream.getvalue(), f"{name}-axis-{self._trace.axis}-mapped.mcap")


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
