"""The jog pad: hold a button to move an axis, or step it by a distance."""

from __future__ import annotations

from mcclient import AxisInfo, Info
from nicegui import ui

from mcserver.web.actions import Actions
from mcserver.web.formatting import axis_name, limits_text
from mcserver.web.jogging import HOLD_S, Move
from mcserver.web.panels.card import card
from mcserver.web.panels.held_buttons import HeldButtons, JogPad
from mcserver.web.translation import mark, t

STEPS = (0.0, 0.01, 0.1, 1.0, 10.0, 100.0)
SPEEDS = (1, 5, 10, 25, 50, 100)


class JogPanel:
    """Two buttons an axis; the pad is built anew when the machine's axes change."""

    def __init__(self, actions: Actions, held: HeldButtons) -> None:
        self._actions = actions
        self._axes: dict[int, AxisInfo] = {}
        self._joints: dict[int, str] = {}
        # two browsers of one person are two people to an axis
        self._by = actions.driver.name
        with card(t("Jog")):
            with ui.row().classes("items-center w-full gap-4"):
                self._step = ui.select(
                    {0.0: t("while held"), **{step: t("step {step:g}", step=step) for step in STEPS[1:]}},
                    value=0.0,
                    label=t("Distance"),
                ).classes("min-w-32")
                self._speed = ui.select(
                    {each: f"{each} %" for each in SPEEDS}, value=10, label=t("Speed")
                ).classes("min-w-28")
            self._pad = ui.element("div").classes("mc-jog")
        held.add("axis", JogPad("jog", self._press, self._move))

    def update(self, info: Info) -> None:
        axes, joints = {axis.index: axis for axis in info.axes}, self._actions.link.joints
        if axes == self._axes and joints == self._joints:
            return
        self._axes, self._joints = axes, joints
        self._pad.clear()
        with self._pad:
            for axis in info.axes:
                with ui.element("div").classes("mc-jog-axis"):
                    with ui.element("div").classes("leading-tight min-w-0").tooltip(limits_text(axis)):
                        ui.label(axis_name(axis.index)).classes("font-bold")
                        if axis.index in joints:
                            ui.label(joints[axis.index]).classes("text-xs break-words")
                    minus, plus = mark("jog axis {axis} minus"), mark("jog axis {axis} plus")
                    for direction, sign, label in ((-1, "−", minus), (1, "+", plus)):
                        ui.button(f"{axis_name(axis.index)}{sign}").props(
                            f"outline data-jog=axis data-what={axis.index} data-direction={direction} "
                            f'aria-label="{t(label, axis=axis_name(axis.index))}"'
                        )

    def _move(self, what: str, direction: int) -> Move | None:
        axis = self._axis(what)
        if axis is None or self._step.value:
            return None
        velocity = direction * axis.max_velocity * self._speed.value / 100.0

        async def move(program: str | None) -> str:
            machine = self._actions.link.connected()
            return await machine.jog(
                axis.index, velocity=velocity, hold_s=HOLD_S, program=program, by=self._by
            )

        return move

    async def _press(self, what: str, direction: int) -> None:
        axis, distance = self._axis(what), direction * self._step.value
        if axis is None or not distance:
            return
        velocity = axis.max_velocity * self._speed.value / 100.0
        await self._actions.do(
            "jog",
            mark(
                "jog {axis} {distance:+g} {unit}",
                axis=axis_name(axis.index),
                distance=distance,
                unit=axis.unit,
            ),
            lambda machine: machine.jog(axis.index, distance, velocity=velocity, by=self._by),
        )

    def _axis(self, what: str) -> AxisInfo | None:
        return self._axes.get(int(what)) if what.isdecimal() else None
