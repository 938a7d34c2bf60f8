"""A recording played in space: a slider over its time, and the machine as it was."""

from __future__ import annotations

import msgspec
from mcclient import MotionError
from nicegui import ui

from mcserver.web.actions import show_refusal
from mcserver.web.dialogs import named_dialog
from mcserver.web.formatting import axis_name, position_text
from mcserver.web.link import MachineLink
from mcserver.web.space import Space

STEP_S = 0.05


class Tip(msgspec.Struct, frozen=True):
    """Where one tool was; None: the axes 0, 1 and 2."""

    tool: int | None
    points: list[list[float]]


class Replay(msgspec.Struct, frozen=True):
    """What `mcserver.web.replay` has made."""

    time_s: list[float]
    line: list[int]
    axes: list[int]
    position: list[list[float]]
    tips: list[Tip]


async def show_replay(link: MachineLink, name: str) -> None:
    """Open a recording in a dialog; what is wrong with it is shown instead."""
    waiting = ui.notification(f"{name} is being read", spinner=True, timeout=None, position="top")
    try:
        path = await link.recorded.replay(link.connected(), name)
        replay = msgspec.json.decode(path.read_bytes(), type=Replay)
    except (MotionError, OSError, msgspec.DecodeError) as error:
        if isinstance(error, MotionError):
            show_refusal(f"{error.message} [{error.code}]", error.hint)
        else:
            show_refusal(f"{name} cannot be played: {error}")
        return
    finally:
        waiting.dismiss()
    Player(link, name, replay).open()


class Player:
    """One recording, being played in a dialog."""

    def __init__(self, link: MachineLink, name: str, replay: Replay) -> None:
        self._replay = replay
        self._playing = False
        with named_dialog(f"{name}, played").props("maximized") as self._dialog, ui.card().classes("mc-card"):
            with ui.row().classes("w-full items-center justify-between"):
                ui.label(name).classes("font-bold grow break-all")
                ui.button("Close", on_click=self._dialog.close).props("flat")
            self._space = Space(f"{name}, played", f"/machine/{link.name}/model").classes("mc-replay")
            self._space.on("ready", self._begin, args=[])
            with ui.row().classes("w-full items-center no-wrap"):
                self._button = ui.button("Play", on_click=self._toggle).props("color=primary")
                self._slider = (
                    ui.slider(min=0, max=len(replay.time_s) - 1, step=1, value=0, on_change=self._show)
                    .props('aria-label="time in the recording"')
                    .classes("grow")
                )
            self._text = ui.label("").classes("font-mono text-sm")
            self._timer = ui.timer(STEP_S, self._step)
        self._dialog.on("hide", self._close)

    def open(self) -> None:
        self._dialog.open()

    def _begin(self) -> None:
        tips = [{"tool": tip.tool, "points": tip.points} for tip in self._replay.tips]
        # each row a line of its own, so that what is done ends at the row that is shown
        self._space.plan({"lines": list(range(1, len(self._replay.time_s) + 1)), "tips": tips})
        self._show()

    def _row(self) -> int:
        return min(max(int(self._slider.value or 0), 0), len(self._replay.time_s) - 1)

    def _show(self) -> None:
        row, replay = self._row(), self._replay
        axes = dict(zip(replay.axes, replay.position[row], strict=True))
        tips = {"" if tip.tool is None else f"T{tip.tool}": tip.points[row] for tip in replay.tips}
        self._space.show_row(axes, tips, row)
        shown = "  ".join(f"{axis_name(axis)} {position_text(at)}" for axis, at in list(axes.items())[:12])
        self._text.set_text(f"{replay.time_s[row]:.3f} s   line {replay.line[row]}   {shown}")

    def _toggle(self) -> None:
        self._playing = not self._playing
        if self._playing and self._row() == len(self._replay.time_s) - 1:
            self._slider.set_value(0)
        self._button.set_text("Pause" if self._playing else "Play")

    def _step(self) -> None:
        if not self._playing:
            return
        times, row = self._replay.time_s, self._row()
        until = times[row] + STEP_S
        while row < len(times) - 1 and times[row] < until:
            row += 1
        self._slider.set_value(row)
        if row == len(times) - 1:
            self._toggle()

    def _close(self) -> None:
        self._timer.cancel()
        self._dialog.delete()
