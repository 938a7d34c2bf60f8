"""A scope: what the cycle has of an axis, every cycle, drawn as it comes or around a trigger, and as MCAP."""

from __future__ import annotations

import asyncio
import math

from mcclient import Machine, MotionError
from nicegui import ui

from mcserver.canopen.scope import FOLLOWING_ERROR, ScopeTrace, Trigger
from mcserver.web.actions import Actions, show_error, show_refusal
from mcserver.web.choice import Choice
from mcserver.web.formatting import axis_name
from mcserver.web.panels.card import card
from mcserver.web.panels.traces import download_trace, draw_trace, span_choice
from mcserver.web.sample_scope import (
    POSITION,
    QUANTITIES,
    SETPOINT,
    TORQUE,
    VELOCITY,
    SampleScope,
)
from mcserver.web.translation import mark, t

# of a trace, before its trigger
BEFORE = 0.25
NAMES = {
    SETPOINT: mark("setpoint"),
    POSITION: mark("position"),
    FOLLOWING_ERROR: mark("following error"),
    VELOCITY: mark("velocity"),
    TORQUE: mark("torque"),
}
ABOVE, BELOW = "above", "below"


class ScopePanel:
    """One axis at a time; a trace stays until the next one begins."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._scope: SampleScope | None = None
        self._task: asyncio.Task[None] | None = None
        self._machine: Machine | None = None
        self._axes: tuple[int, ...] = ()
        self._drawn: object = None
        names = {name: t(text) for name, text in NAMES.items()}
        with card(t("Scope")):
            with ui.row().classes("w-full items-center gap-2"):
                self._axis = Choice({}, label=t("Axis")).props("dense").classes("w-20")
                self._curves = (
                    ui.select(
                        names,
                        value=[SETPOINT, POSITION, FOLLOWING_ERROR],
                        multiple=True,
                        label=t("Curves"),
                        on_change=self._redraw,
                    )
                    .props("use-chips dense")
                    .classes("grow basis-48 min-w-0")
                )
                self._span = span_choice()
            with ui.row().classes("w-full items-center gap-2"):
                self._way = (
                    ui.select(
                        {"": t("no trigger"), ABOVE: t("rises above"), BELOW: t("falls below")},
                        value="",
                        label=t("Trigger"),
                        on_change=self._on_way,
                    )
                    .props("dense")
                    .classes("grow min-w-28")
                )
                self._source = (
                    ui.select(names, value=FOLLOWING_ERROR, label=t("Of"))
                    .props("dense")
                    .classes("grow min-w-28")
                )
                self._level = ui.number(t("Level"), value=0.01).props("dense").classes("w-24")
            with ui.element("div").classes("mc-buttons"):
                ui.button(t("Start"), on_click=self._start).props("color=primary")
                ui.button(t("Stop"), on_click=self.stop).props("outline")
                self._save = ui.button(t("Download MCAP"), on_click=self._download).props("outline")
            self._said = ui.label("").classes("text-sm").props("role=status")
            self._chart = ui.echart({}).classes("mc-chart")
        self._save.set_enabled(False)
        self._on_way()

    def _on_way(self) -> None:
        for each in (self._source, self._level):
            each.set_enabled(bool(self._way.value))

    async def _start(self) -> None:
        link = self._actions.link
        self._show_axes()
        try:
            machine = link.connected()
        except MotionError as error:
            show_error(error)
            return
        axis = next((each for each in machine.info.axes if each.index == self._axis.value), None)
        level = self._level.value
        trigger = None
        if self._way.value:
            if level is None or not math.isfinite(level):
                show_refusal(t("a trigger needs a level"))
                return
            trigger = Trigger(QUANTITIES.index(self._source.value), level, self._way.value == ABOVE)
        if axis is None:
            return
        self.stop()
        cycles = max(2, round(self._span.value / machine.info.cycle_s))
        self._scope = SampleScope(
            axis.index, axis.unit, machine.info.cycle_s, cycles, round(BEFORE * cycles), trigger
        )
        self._machine, self._drawn = machine, None
        self._task = asyncio.create_task(_follow(machine, self._scope))

    def stop(self) -> None:
        """Take no further cycle; what has come stays."""
        if self._task is not None:
            self._task.cancel()

    def update(self) -> None:
        """Show what has come."""
        self._show_axes()
        scope, task = self._scope, self._task
        if scope is None or task is None:
            return
        trace = scope.trace()
        state = (id(scope), len(trace.values), scope.zero_s, task.done())
        if state == self._drawn:
            return
        self._drawn = state
        self._said.set_text(self._state(scope, task))
        self._save.set_enabled(len(trace.values) > 0 and task.done())
        self._draw(trace)

    def _show_axes(self) -> None:
        machine = self._actions.link.machine
        axes = self._axes if machine is None else tuple(each.index for each in machine.info.axes)
        if axes != self._axes:
            self._axes = axes
            value = self._axis.value if self._axis.value in axes else axes[0] if axes else None
            self._axis.set_options({axis: axis_name(axis) for axis in axes}, value=value)

    def _state(self, scope: SampleScope, task: asyncio.Task[None]) -> str:
        lost = t("{count} cycles were lost on the way", count=scope.lost) if scope.lost else ""
        if not task.done():
            word = t("recording") if scope.triggered or scope.trigger is None else t("waits for the trigger")
        elif scope.is_done or task.cancelled() or task.exception() is None:
            word = t("{count} cycles", count=len(scope.trace().values))
        else:
            word = t("the link was lost")
        return "; ".join(filter(None, [word, lost]))

    def _redraw(self) -> None:
        self._drawn = None

    def _draw(self, trace: ScopeTrace) -> None:
        columns = [at for at, name in enumerate(QUANTITIES) if name in self._curves.value]
        names = [t(NAMES[QUANTITIES[at]]) for at in columns]
        draw_trace(self._chart, trace, columns, names, [trace.units[at] for at in columns])

    def _download(self) -> None:
        scope, machine = self._scope, self._machine
        if scope is not None and machine is not None:
            download_trace(scope.trace(), self._actions.link.name, machine.info.epoch + scope.zero_s)


async def _follow(machine: Machine, scope: SampleScope) -> None:
    """Feed a scope until it has everything, is cancelled or the link ends."""
    async with machine.samples() as feed:
        async for samples in feed:
            scope.take(samples)
            if scope.is_done:
                return
