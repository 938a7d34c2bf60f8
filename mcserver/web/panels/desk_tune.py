"""The gains of cst and csv: an axis is shaken by a program, or moved by another one, and its loop judged."""

from __future__ import annotations

import html
import json
import math

from mcclient import AxisInfo, Machine, MotionError
from mcclient.types import DriveTuning, TunedLoop
from nicegui import ui

from mcserver.canopen.chirp import CHIRP_AROUND_S, HIGHEST_SHARE, chirp_lines
from mcserver.errors import McError
from mcserver.gcode.text.words import AXIS_LETTERS
from mcserver.web.actions import Actions, show_error, show_refusal
from mcserver.web.dialogs import ask
from mcserver.web.formatting import axis_name
from mcserver.web.panels.card import card, scrolled
from mcserver.web.panels.desk_bus import table_html
from mcserver.web.panels.desk_drive import DeskDrive
from mcserver.web.translation import mark, t

SECONDS = (10, 20, 40)


class TunePanel:
    """What `mcserver drives tune` says of the chosen drive; gains are written into the machine file."""

    def __init__(self, actions: Actions, drive: DeskDrive) -> None:
        self._actions = actions
        self._drive = drive
        with card(t("Tune")):
            with ui.row().classes("w-full items-center gap-2"):
                self._room = (
                    ui.number(t("Longest move"), value=10, min=0.001).props("dense").classes("grow min-w-24")
                )
                self._seconds = (
                    ui.select({each: f"{each} s" for each in SECONDS}, value=20, label=t("Span"))
                    .props("dense")
                    .classes("w-24")
                )
            with ui.element("div").classes("mc-buttons"):
                self._buttons = [
                    ui.button(t("Shake and measure"), on_click=self._shake).props("color=warning"),
                    ui.button(t("Measure what moves"), on_click=self._measure).props("outline"),
                ]
            self._said = ui.label("").classes("text-sm break-words").props("role=status")
            self._report = scrolled(t("Tune"))
            self._chart = ui.echart({}).classes("mc-chart")
            self._chart.set_visibility(False)
        drive.on_change(self._clear)

    def _clear(self) -> None:
        self._said.set_text("")
        self._report.set_content("")
        self._chart.set_visibility(False)

    async def _shake(self) -> None:
        drive, room = self._drive.chosen(), self._room.value
        if drive is None or not self._actions.allowed("open"):
            return
        if not room or not math.isfinite(room):
            show_refusal(t("no length was given"), t("give the room that the axis has above where it stands"))
            return
        try:
            machine = self._actions.link.connected()
            axis = next(each for each in machine.info.axes if each.index == drive.axis)
        except MotionError as error:
            show_error(error)
            return
        question = t(
            "{axis} is energized and shaken for {seconds:g} s: up to {room:g} {unit} towards greater "
            "positions, up to {rate:.0f} Hz, at the limits of the machine file.",
            axis=axis_name(axis.index),
            seconds=self._seconds.value + CHIRP_AROUND_S,
            room=room,
            unit=axis.unit,
            rate=HIGHEST_SHARE / machine.info.cycle_s,
        )

        async def queue(connected: Machine) -> None:
            text = "\n".join(self._lines(axis, connected.info.cycle_s, room))
            jobs, visitor = self._actions.link.jobs, self._actions.visitor
            jobs.add_text(f"chirp {axis_name(axis.index)}", text, visitor.name)

        name = mark("shake {axis}", axis=axis_name(axis.index))
        if await ask(
            question, t("Shake"), colour="warning", act=lambda: self._actions.do("open", name, queue)
        ):
            await self._measure()

    def _lines(self, axis: AxisInfo, cycle_s: float, room: float) -> list[str]:
        words = {number: letter for letter, number in AXIS_LETTERS.items()}
        word = axis.letter or words.get(axis.index, f"[{axis.index}]")
        return chirp_lines(axis, word, self._seconds.value + CHIRP_AROUND_S, cycle_s, room=room)

    async def _measure(self) -> None:
        drive = self._drive.chosen()
        if drive is None or not self._actions.has_role("drive_tune"):
            return
        self._clear()
        self._said.set_text(t("the motion is measured for {seconds:g} s", seconds=self._seconds.value))
        for button in self._buttons:
            button.set_enabled(False)
        try:
            machine = self._actions.link.connected()
            found = await machine.drive_tune(drive.axis, seconds=float(self._seconds.value))
        except (MotionError, McError) as error:
            self._said.set_text(f"{t(error.message)} [{error.code}]")
            show_error(error)
            return
        finally:
            for button in self._buttons:
                button.set_enabled(True)
        self._show(found)

    def _show(self, found: DriveTuning) -> None:
        verdict = (
            t("the machine file does not fit: change it so") if found.changes else t("the machine file fits")
        )
        self._said.set_text(verdict)
        lines = f"<pre>{html.escape(chr(10).join(found.changes))}</pre>" if found.changes else ""
        measured = [(name, f"{value:.4g}") for name, value in found.measured.items()]
        self._report.set_content(
            table_html((t("Measured"), t("Value")), measured) + loops_html(found) + lines
        )
        self._chart.set_visibility(bool(found.frequency_hz))
        if found.frequency_hz:
            message = {
                "names": [t("gain of the loop"), t("phase")],
                "units": ["dB", "°"],
                "steps": [False, False],
                "span": found.frequency_hz[-1],
                "rows": list(zip(found.frequency_hz, found.gain_db, found.phase_deg, strict=True)),
                "restart": True,
                "zero": 0,
                "across": "Hz",
            }
            ui.run_javascript(f"mcChart({self._chart.id}, {json.dumps(message)})")


def loops_html(found: DriveTuning) -> str:
    """Return a table of loops: gains, and what they leave by the model and as measured."""
    names = list(found.loops[0].gains)
    titles = (
        t("Gains"),
        *names,
        t("stable for inertia ×") if found.mode == "cst" else t("stable up to gain ×"),
        t("phase left"),
        t("as measured"),
    )
    return table_html(titles, [_row(each, names, found.mode) for each in found.loops])


def _row(loop: TunedLoop, names: list[str], mode: str) -> list[str]:
    stable = f"{loop.least:.2f} – {loop.greatest:.1f}" if mode == "cst" else f"{loop.greatest:.1f}"
    measured = "–"
    if loop.measured_phase_deg is not None:
        gain = "" if loop.measured_gain is None else f", × {loop.measured_gain:.1f}"
        measured = f"{loop.measured_phase_deg:.0f}° ({loop.crossover_hz:.1f} Hz){gain}"
    return [
        t(loop.name),
        *(f"{loop.gains[name]:.4g}" for name in names),
        stable if loop.greatest else t("not stable"),
        f"{loop.phase_deg:.0f}°",
        measured,
    ]


# names of loops, as the server gives them
LOOPS = (mark("machine file"), mark("by this inertia"), mark("by this drive"))
