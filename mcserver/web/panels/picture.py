"""The machine in space: what it looks like, the path of its program, and where its tips went."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec
from mcclient import MachineStatus
from mcclient.types import AxisInfo, Info
from nicegui import ui

from mcserver.view.zeros import work_zeros
from mcserver.web.formatting import current_program
from mcserver.web.link import MachineLink
from mcserver.web.panels.card import heading
from mcserver.web.space import Space
from mcserver.web.translation import t

# A point is drawn when it lies this far from the one before [mm].
TRAIL_STEP = 0.05
# Points that are sent at once: what was travelled before this page was opened.
MOST_AT_ONCE = 2000

Point = list[float]
Bodies = tuple[list[dict[str, Any]], dict[str, bool]]


class PicturePanel:
    """One card; the path of a program is that of the job under way, or of the dry run asked for last."""

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        self._last: dict[str, Point] = {}
        self._shown_until: tuple[str, float] = ("", 0.0)
        self._planned: dict[str, Any] | None = None
        self._restart = False
        self._zeros: dict[str, list[float]] = {}
        self._bodies: Bodies | None = None
        with ui.card().classes("mc-card"):
            with ui.row().classes("items-center w-full justify-between"):
                heading(t("Path"))
                with ui.row().classes("gap-1"):
                    self._reach = ui.checkbox(t("Reach"), on_change=self._mark_reach).props("dense data-look")
                    self._reach.tooltip(t("where tips can be by the axes' travel; bodies are not looked at"))
                    self._reach.set_visibility(False)
                    ui.button(t("Look at all"), on_click=self._look).props("flat dense data-look")
                    ui.button(t("Clear"), on_click=self._clear).props("flat dense data-look")
            self._space = Space(
                t("{name} and its path", name=link.name), f"/machine/{link.name}/model"
            ).classes("mc-trail")
            self._space.on("ready", self._again, args=[])
            self._space.on("picked", lambda event: self._show_line(int(event.args)))
            ui.html(
                f'<div class="mc-legend"><span class="come">{t("to come")}</span>'
                f'<span class="done">{t("done")}</span><span class="trail">{t("travelled")}</span></div>',
                sanitize=False,
            )
            self._line = ui.label("").classes("font-mono text-sm break-words").props("aria-live=polite")

    def update(self, status: MachineStatus) -> None:
        if not self._space.is_ready:
            return
        self._reach.set_visibility(bool(status.tools))
        job = self._link.jobs.latest
        path = None if job is None else job.path
        if path is not self._planned:
            self._planned = path
            self._space.plan(path)
            self._line.set_text("")
        # in the picture of tools, whose coordinates are their base's, zeros of axes have no place
        zeros = {} if status.tools else work_zeros({each.system: each.origin for each in status.work_offsets})
        if zeros != self._zeros:
            self._zeros = zeros
            self._space.zeros(zeros)
        bodies = _bodies_of(status)
        if bodies != self._bodies:
            self._bodies = bodies
            self._space.show_bodies(*bodies)
        since, self._shown_until = self._shown_until, (status.instance, status.t)
        if since == self._shown_until and not self._restart:
            return
        states = []
        for state in reversed(self._link.history):
            if (state.instance, state.t) == since:
                break
            states.append(state)
        trail = _thinned(reversed(states), self._last)
        program = current_program(status)
        line = program.line if job is not None and program and program.program == job.program else 0
        axes = dict(zip(status.axes.index, (round(each, 4) for each in status.axes.position), strict=True))
        self._space.place(axes, tips_of(status), line, trail, restart=self._restart)
        self._restart = False

    def _show_line(self, line: int) -> None:
        """Say which line of the program drives where somebody has clicked, and mark all of it."""
        job = self._link.jobs.latest
        if job is not None and 0 < line <= len(job.lines):
            self._line.set_text(f"{t('line {line}', line=line)}   {job.lines[line - 1].strip()}")
            self._space.mark_line(line)

    def _again(self) -> None:
        """A new picture, as after the browser was reloaded, knows nothing yet."""
        self._planned, self._last, self._shown_until, self._restart = None, {}, ("", 0.0), True
        self._zeros, self._bodies = {}, None
        self._mark_reach()

    def _mark_reach(self) -> None:
        machine = self._link.machine
        self._space.reach(travel_of(machine.info) if machine is not None and self._reach.value else {})

    def _look(self) -> None:
        self._space.look_at_all()

    def _clear(self) -> None:
        status = self._link.status
        if status is not None:
            self._shown_until = (status.instance, status.t)
        self._last, self._restart = {}, True


def travel_of(info: Info) -> dict[str, dict[int, tuple[float, float]]]:
    """Return how far the axes of each tool travel [mm, deg], by ``T`` and its number; of endless turns one.

    Left out is a tool with an axis that goes straight on without an end.
    """
    spans = {axis.index: _span(axis) for axis in info.axes}
    found = {}
    for tool in info.tools:
        travel = {axis: span for axis in tool.axes if (span := spans[axis]) is not None}
        if len(travel) == len(tool.axes):
            found[f"T{tool.number}"] = travel
    return found


def _span(axis: AxisInfo) -> tuple[float, float] | None:
    if axis.min_position is not None and axis.max_position is not None:
        return axis.min_position, axis.max_position
    return (-180.0, 180.0) if axis.unit == "deg" else None


def _bodies_of(status: MachineStatus) -> Bodies:
    """Return the tools that are mounted, and which inputs are high."""
    levels = {each.name: each.value > 0.5 for each in status.inputs}
    return [msgspec.to_builtins(each) for each in status.mounted], levels


def tips_of(status: MachineStatus) -> dict[str, Point]:
    """Where the tools' tips are [mm], by ``T`` and their number; without tools the axes 0, 1 and 2."""
    if status.tools:
        return {f"T{tool.number}": [round(value, 3) for value in tool.position] for tool in status.tools}
    found = dict(zip(status.axes.index, status.axes.position, strict=True))
    return {"": [round(found.get(index, 0.0), 3) for index in range(3)]}


def _thinned(states: Iterable[MachineStatus], last: dict[str, Point]) -> dict[str, list[Point]]:
    """The places that lie `TRAIL_STEP` from the one before, which ``last`` keeps from call to call."""
    kept: dict[str, list[Point]] = {}
    for state in states:
        for label, place in tips_of(state).items():
            before = last.get(label)
            if before is None or max(abs(a - b) for a, b in zip(place, before, strict=True)) >= TRAIL_STEP:
                kept.setdefault(label, []).append(place)
                last[label] = place
    return {label: points[-MOST_AT_ONCE:] for label, points in kept.items()}
