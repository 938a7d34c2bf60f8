"""The tool's jog pad: a robot's tip along and about axes of the base or of the tool, held or by steps."""

from __future__ import annotations

import asyncio

from mcclient import Info, Machine, MotionError, ToolInfo
from mcclient.broken_off import TOOL_STEP
from mcclient.types import ToolDirection, ToolPose
from nicegui import ui

from mcserver.web.actions import Actions, show_refusal
from mcserver.web.jogging import HOLD_S, Move
from mcserver.web.open_programs import refuse_open
from mcserver.web.panels.card import card
from mcserver.web.panels.held_buttons import HeldButtons, JogPad
from mcserver.web.tool_steps import Frame, step_lines
from mcserver.web.translation import mark, t

STEPS = (0.1, 1.0, 5.0, 10.0, 50.0)
SPEEDS = (1, 5, 10, 25, 50, 100, 250)
# steps that wait or are under way
MOST = 8
WHY = mark("a step of the tool would wait for its end")


class ToolJogPanel:
    """Two buttons a direction; hidden where programs have no tools of a robot.

    Attributes:
        tool: the chosen one; None: there is none. speed: chosen [mm/s].
    """

    def __init__(self, actions: Actions, held: HeldButtons) -> None:
        self._actions = actions
        self._tools: dict[int, ToolInfo] = {}
        self._turn = asyncio.Lock()
        self._waiting = 0
        # steps of before it was last raised do not run
        self._round = 0
        with card(t("Tool jog")) as self._card:
            with ui.row().classes("items-center w-full gap-4"):
                self._choice = ui.select({}, label=t("Tool"), on_change=self._build).classes("min-w-32")
                self._frame = ui.select(
                    {"base": t("base"), "tool": t("tool")}, value="base", label=t("Along axes of")
                ).classes("min-w-28")
                self._step = ui.select(
                    {0.0: t("while held"), **{step: f"{step:g} mm, deg" for step in STEPS}},
                    value=0.0,
                    label=t("Step"),
                ).classes("min-w-32")
                self._speed = ui.select(
                    {each: f"{each} mm/s, deg/s" for each in SPEEDS}, value=10, label=t("Speed of the tip")
                ).classes("min-w-36")
            self._pad = ui.element("div").classes("mc-jog")
            self._end = ui.label("").classes("text-sm break-words").props("aria-live=polite")
        held.add("tool", JogPad("jog_tool", self._press, self._held_move))
        self._card.set_visibility(False)

    @property
    def tool(self) -> ToolInfo | None:
        return self._tools.get(self._choice.value)

    @property
    def speed(self) -> float:
        return float(self._speed.value)

    def update(self, info: Info) -> None:
        # in the dialects with work coordinates T is a tool of the magazine
        tools = {} if self._actions.link.has_work_offsets else {tool.number: tool for tool in info.tools}
        if tools == self._tools:
            return
        self._tools = tools
        self._card.set_visibility(bool(tools))
        kept = self._choice.value if self._choice.value in tools else next(iter(tools), None)
        names = {number: f"T{number} {tool.frame}" for number, tool in tools.items()}
        self._choice.set_options(names, value=kept)
        self._build()

    def _build(self) -> None:
        self._pad.clear()
        tool = self.tool
        if tool is None:
            return
        # the poses of a tool whose work another link carries are in that link's frame
        base = t("work") if tool.work else t("base")
        self._frame.set_options({"base": base, "tool": t("tool")}, value=self._frame.value)
        with self._pad:
            for word in "XYZABC" if tool.orientation else "XYZ":
                with ui.element("div").classes("mc-jog-axis"):
                    ui.label(word).classes("font-bold")
                    minus, plus = mark("jog tool {axis} minus"), mark("jog tool {axis} plus")
                    for direction, sign, label in ((-1, "−", minus), (1, "+", plus)):
                        ui.button(f"{word}{sign}").props(
                            f"outline data-jog=tool data-what={word} data-direction={direction} "
                            f'aria-label="{t(label, axis=word)}"'
                        )

    def drop(self) -> None:
        """Let no step run that still waits: its browser is gone, or the one before it was broken off."""
        self._round += 1

    def _held_move(self, word: str, direction: int) -> Move | None:
        tool = self.tool
        if tool is None or self._step.value or word not in list(ToolDirection):
            return None
        self._end.set_text("")
        towards = ToolDirection(word)
        velocity, frame, by = direction * self.speed, self._frame.value, self._actions.driver.name

        async def move(program: str | None) -> str:
            reply = await self._actions.link.connected().jog_tool(
                tool.number, towards, velocity, frame=frame, hold_s=HOLD_S, program=program, by=by
            )
            if reply.obstacle:
                self._end.set_text(
                    t(
                        "{direction} ends where {obstacle}",
                        direction=f"{word}{'+' if direction > 0 else '−'}",
                        obstacle=t(reply.obstacle),
                    )
                )
            return reply.program

        return move

    async def _press(self, word: str, direction: int) -> None:
        tool = self.tool
        known = word in list(ToolDirection)
        if tool is None or not known or not self._step.value or not self._actions.allowed("open"):
            return
        if self._waiting >= MOST:
            show_refusal(t("{count} steps of the tool wait", count=MOST), t("let some of them end"))
            return
        amount, frame, speed, turn = direction * self._step.value, self._frame.value, self.speed, self._round
        self._waiting += 1
        try:
            async with self._turn:
                # control may have been taken away while it waited
                if turn == self._round and self._actions.has_control:
                    await self._move(tool, word, amount, frame, speed)
        finally:
            self._waiting -= 1

    async def _move(self, tool: ToolInfo, word: str, amount: float, frame: Frame, speed: float) -> None:
        async def step(machine: Machine) -> None:
            status = await machine.status()
            refuse_open(self._actions.link, status.programs, WHY)
            lines = step_lines(tool, pose_of(status.tools, tool), word, amount, speed=speed, frame=frame)
            name = f"{TOOL_STEP}{word} by {self._actions.driver.name}"
            async with machine.program(name, axes=tool.axes) as program:
                await program.send_lines(lines)

        what = mark(
            "step T{number} {axis} {amount:+g} along the {frame}",
            number=tool.number,
            axis=word,
            amount=amount,
            frame=mark(frame),
        )
        if not await self._actions.do("open", what, step):
            self.drop()


def pose_of(poses: tuple[ToolPose, ...], tool: ToolInfo) -> ToolPose:
    """Return where a tool is; raises MotionError (MC530) where the server does not say so."""
    found = next((each for each in poses if each.number == tool.number), None)
    if found is None:
        raise MotionError(
            "MC530", t("the server does not say where T{number} is", number=tool.number), t("is it starting?")
        )
    return found
