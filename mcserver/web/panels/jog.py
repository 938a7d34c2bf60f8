"""The jog pad: hold a button to move an axis, or step it by a distance."""

from __future__ import annotations

import time
from typing import Any

from mcclient import AxisInfo, Info
from nicegui import events, ui

from mcserver.web.actions import Actions, show_refusal
from mcserver.web.formatting import axis_name, limits_text
from mcserver.web.jogging import HeldJog

STEPS = (0.0, 0.01, 0.1, 1.0, 10.0, 100.0)
SPEEDS = (1, 5, 10, 25, 50, 100)


class JogPanel:
    """Two buttons an axis; the pad is built anew when the machine's axes change."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._held: HeldJog | None = None
        self._axes: dict[int, AxisInfo] = {}
        self._joints: dict[int, str] = {}
        # two browsers of one person are two people to an axis
        self._by = actions.driver.name
        with ui.card().classes("mc-card"):
            ui.html("<h2>Jog</h2>", sanitize=False)
            with ui.row().classes("items-center w-full gap-4"):
                self._step = ui.select(
                    {0.0: "while held", **{step: f"step {step:g}" for step in STEPS[1:]}},
                    value=0.0,
                    label="Distance",
                ).classes("min-w-32")
                self._speed = ui.select(
                    {each: f"{each} %" for each in SPEEDS}, value=10, label="Speed"
                ).classes("min-w-28")
            self._pad = ui.element("div").classes("mc-jog")
        ui.on("mc_jog", self._on_jog)
        ui.on("mc_clock", lambda event: self._held and self._held.observe(float(event.args["sent_s"])))

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
                    for direction, sign, word in ((-1, "−", "minus"), (1, "+", "plus")):
                        ui.button(f"{axis_name(axis.index)}{sign}").props(
                            f"outline data-jog data-axis={axis.index} data-direction={direction} "
                            f'aria-label="jog axis {axis_name(axis.index)} {word}"'
                        )

    async def release(self) -> None:
        """Stop what this browser holds: it has gone."""
        if self._held is not None:
            await self._held.release()

    async def _on_jog(self, event: events.GenericEventArguments) -> None:
        message: dict[str, Any] = event.args
        kind = message.get("kind")
        if kind == "release":
            await self.release()
            return
        try:
            press, axis, sent_s = (
                int(message["press"]),
                self._axes[int(message["axis"])],
                float(message["sent_s"]),
            )
            direction = 1.0 if int(message["direction"]) > 0 else -1.0
        except (KeyError, TypeError, ValueError):
            return
        if kind == "press" and not self._actions.allowed("jog"):
            return
        if not self._actions.has_control:
            # it was taken away, or the login has ended
            await self.release()
            return
        if self._actions.link.machine is None:
            return
        if self._held is None:
            self._held = HeldJog(self._actions.link.machine, time.monotonic, show_refusal, self._by)
        self._held.machine = self._actions.link.machine
        velocity = direction * axis.max_velocity * self._speed.value / 100.0
        if kind == "keep":
            await self._held.keep(press, sent_s)
        elif kind == "press" and self._step.value:
            distance = direction * self._step.value
            await self._actions.do(
                "jog",
                f"jog {axis_name(axis.index)} {distance:+g} {axis.unit}",
                lambda machine: machine.jog(axis.index, distance, velocity=abs(velocity), by=self._by),
            )
        elif kind == "press":
            await self._held.press(press, axis.index, velocity, sent_s)
