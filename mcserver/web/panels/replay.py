"""A run played in space: a slider over its time, and the machine as it was."""

from __future__ import annotations

import html
import itertools
import math
from collections.abc import Iterable

import msgspec
from mcclient import MotionError
from nicegui import ui

from mcserver.web.actions import show_error, show_refusal
from mcserver.web.dialogs import NamedDialog
from mcserver.web.link import MachineLink
from mcserver.web.playback import SPEEDS, Playback
from mcserver.web.replay_format import Replay, ReplayAxis
from mcserver.web.space import Space
from mcserver.web.translation import t

STEP_S = 0.05
MOST_AXES = 24
# an axis that moves less stands still [mm, deg]
LEAST_TRAVEL = 1e-3


async def show_replay(link: MachineLink, name: str) -> None:
    """Open a recording in a dialog; what is wrong with it is shown instead."""
    waiting = ui.notification(
        t("{name} is being read", name=name), spinner=True, timeout=None, position="bottom"
    )
    try:
        path = await link.recorded.replay(link.connected(), name)
        replay = msgspec.json.decode(path.read_bytes(), type=Replay)
    except (MotionError, OSError, msgspec.DecodeError) as error:
        if isinstance(error, MotionError):
            show_error(error)
        else:
            show_refusal(t("{name} cannot be played: {error}", name=name, error=error))
        return
    finally:
        waiting.dismiss()
    # a long one may come when its page is closed
    if ui.context.client.is_deleted:
        return
    with (
        NamedDialog(t("{name}, played", name=name)).props("maximized") as dialog,
        ui.card().classes("mc-card"),
    ):
        with ui.row().classes("w-full items-center justify-between"):
            ui.label(name).classes("font-bold grow break-all")
            ui.button(t("Close"), on_click=dialog.close).props("flat")
        player = Player(t("{name}, played", name=name), replay, f"/machine/{link.name}/model")

    def close() -> None:
        player.close()
        dialog.delete()

    dialog.on("hide", close)
    dialog.open()


class Player:
    """The picture of a run with its controls, built where it is made.

    Args:
        title: of the picture. model_url: of the machine's parts. playing: it begins by itself.
    """

    def __init__(self, title: str, replay: Replay, model_url: str, *, playing: bool = False) -> None:
        self._replay = replay
        self._playback = Playback(replay.time_s, playing=playing)
        self._spans = spans_of(replay.line)
        self._axes = moving(replay)
        self._space = Space(title, model_url).classes("mc-replay")
        self._space.on("ready", self._begin, args=[])
        with ui.row().classes("w-full items-center no-wrap"):
            self._button = ui.button(t("Pause") if playing else t("Play"), on_click=self._toggle)
            self._button.props("color=primary")
            self._slider = (
                ui.slider(min=0, max=len(replay.time_s) - 1, step=1, value=0, on_change=self._seek)
                .props(f'aria-label="{t("time in the recording")}"')
                .classes("grow")
            )
        with ui.row().classes("w-full items-center"):
            speeds = ui.select(list(SPEEDS), label=t("speed ×"), value="1", on_change=self._take_speed)
            speeds.classes("w-24")
            ui.checkbox(t("repeat")).bind_value_to(self._playback, "repeat")
            ui.checkbox(t("joint frames"), on_change=lambda event: self._space.frames(event.value))
            ui.button(t("Look at all"), on_click=self._space.look_at_all).props("flat dense")
        self._text = ui.label("").classes("font-mono text-sm break-words")
        self._values = ui.html("", sanitize=False).classes("w-full")
        self._timer = ui.timer(STEP_S, self._step)

    def close(self) -> None:
        """End the clock."""
        self._timer.cancel()

    def _begin(self) -> None:
        tips = [{"tool": tip.tool, "points": tip.points} for tip in self._replay.tips]
        # each row a line of its own, so that what is done ends at the row that is shown
        self._space.plan({"lines": list(range(1, len(self._replay.time_s) + 1)), "tips": tips})
        self._space.zeros(self._replay.zeros)
        self._show()

    def _show(self) -> None:
        row, replay = self._playback.row, self._replay
        position = replay.position[row]
        axes = {axis.number: at for axis, at in zip(replay.axes, position, strict=True)}
        tips = {tip.label: tip.points[row] for tip in replay.tips}
        self._space.show_row(axes, tips, row, self._spans[row])
        line = replay.line[row]
        shown = f"{replay.time_s[row]:.3f} s" + (f"   {t('line {line}', line=line)}" if line else "")
        self._text.set_text(f"{shown}   {replay.text.get(line, '').strip()}")
        self._values.set_content(axes_html((axis, position[column]) for column, axis in self._axes))

    def _toggle(self) -> None:
        self._playback.toggle()
        self._button.set_text(t("Pause") if self._playback.playing else t("Play"))

    def _step(self) -> None:
        if not self._space.is_ready or not self._playback.playing:
            return
        self._playback.advance(STEP_S)
        self._slider.set_value(self._playback.row)
        if not self._playback.playing:
            self._button.set_text(t("Play"))

    def _seek(self) -> None:
        """Go to the slider's row, unless it is there because time has gone on."""
        row = min(max(int(self._slider.value or 0), 0), len(self._replay.time_s) - 1)
        if row != self._playback.row:
            self._playback.seek(self._replay.time_s[row])
        self._show()

    def _take_speed(self, event: object) -> None:
        self._playback.speed = float(getattr(event, "value", 1.0))


def spans_of(lines: list[int]) -> list[tuple[int, int] | None]:
    """Return the first and last row of each row's line, from the row that it begins at; None: no line."""
    spans: list[tuple[int, int] | None] = []
    for line, rows in itertools.groupby(lines):
        first, count = len(spans), len(list(rows))
        spans += [(max(0, first - 1), first + count - 1) if line else None] * count
    return spans


def moving(replay: Replay) -> list[tuple[int, ReplayAxis]]:
    """Return the axes that move, with their columns; all, where none does."""
    columns = list(enumerate(replay.axes))
    found = [
        (column, axis)
        for column, axis in columns
        if max(row[column] for row in replay.position) - min(row[column] for row in replay.position)
        > LEAST_TRAVEL
    ]
    return found or columns


def axes_html(axes: Iterable[tuple[ReplayAxis, float]]) -> str:
    """Return a row for each axis: its value, and where that is within its travel or on its dial."""
    rows = [
        f"<tr><td>{html.escape(axis.name)}</td><td>{round(value, 2) + 0.0:.2f}&nbsp;{axis.unit}</td>"
        f"<td>{_gauge(axis, value)}</td></tr>"
        for axis, value in axes
    ]
    more = len(rows) - MOST_AXES
    note = f"<div>{t('and {count} more', count=more)}</div>" if more > 0 else ""
    return f'<table class="mc-gauges">{"".join(rows[:MOST_AXES])}</table>{note}'


def _gauge(axis: ReplayAxis, value: float) -> str:
    if axis.low is not None and axis.high is not None and axis.high > axis.low:
        share = 100.0 * min(max((value - axis.low) / (axis.high - axis.low), 0.0), 1.0)
        return f'<div class="mc-travel"><div style="left:{share:.2f}%"></div></div>'
    if axis.unit != "°":
        return ""
    x, y = (8.0 * each(math.radians(value)) for each in (math.cos, math.sin))
    return (
        '<svg class="mc-dial" width="24" height="24" viewBox="-12 -12 24 24"><circle r="10"/>'
        f'<line x2="{x:.1f}" y2="{-y:.1f}"/></svg>'
    )
