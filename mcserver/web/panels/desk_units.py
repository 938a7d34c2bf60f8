"""The scale of an axis: from its drive's objects and a pitch, and from a small move that was measured."""

from __future__ import annotations

import html

from mcclient import MotionError
from nicegui import ui

from mcserver.canopen.cycle_samples import POSITION
from mcserver.canopen.desk import Desk
from mcserver.canopen.units_check import (
    ACCURACY,
    LEAST_COUNTS,
    DriveScale,
    compared,
    counted,
    proposed_lines,
    scale_of,
)
from mcserver.web.actions import show_error, show_refusal
from mcserver.web.panels.card import card, scrolled
from mcserver.web.panels.desk_bus import table_html
from mcserver.web.panels.desk_drive import DeskDrive
from mcserver.web.translation import t


class UnitsPanel:
    """What `mcserver drives units` says: nothing is written, and the axis is moved by whoever jogs it."""

    def __init__(self, drive: DeskDrive) -> None:
        self._drive = drive
        # place by the drive's count and by the machine [mm or deg], before the move
        self._before: tuple[int, float] | None = None
        with card(t("Units")):
            with ui.row().classes("w-full items-center gap-2"):
                self._pitch = (
                    ui.number(t("Travel for a turn of the gear's shaft"), min=0)
                    .props("dense")
                    .classes("grow min-w-28")
                )
                ui.button(t("Read the scale"), on_click=self._read).props("outline")
            with ui.row().classes("w-full items-center gap-2"):
                ui.button(t("Begin a move"), on_click=self._begin).props("outline")
                self._moved = (
                    ui.number(t("How far it went, measured")).props("dense").classes("grow min-w-56")
                )
                self._compare_button = ui.button(t("Compare the move"), on_click=self._compare).props(
                    "outline"
                )
            self._said = ui.label("").classes("text-sm break-words").props("role=status")
            self._report = scrolled(t("Units"))
        drive.on_change(self._on_drive)
        self._on_drive()

    def _on_drive(self) -> None:
        self._before = None
        self._compare_button.set_enabled(False)
        self._said.set_text("")
        self._report.set_content("")

    async def _read(self) -> None:
        scale = await self._drive.read(scale_of)
        if scale is None:
            return
        rows = [
            ("608Fh", t("encoder: increments, motor turns"), _ratio(scale.encoder)),
            ("6091h", t("gear: motor turns, shaft turns"), _ratio(scale.gear)),
            ("6092h", t("feed: position units, shaft turns"), _ratio(scale.feed)),
        ]
        lines = proposed_lines(scale, self._pitch.value or None)
        self._show(table_html((t("Object"), t("What"), t("Drive")), rows), lines)

    async def _begin(self) -> None:
        found = await self._place()
        if found is None:
            return
        self._before = found[1:]
        self._compare_button.set_enabled(True)
        self._said.set_text(t("it stands at count {count}: jog the axis, and let it stand", count=found[1]))

    async def _compare(self) -> None:
        before, moved = self._before, self._moved.value
        if before is None or not moved:
            show_refusal(t("no length was given"), t("measure how far the axis went"))
            return
        found = await self._place()
        if found is None:
            return
        scale, count, shown = found
        counts = counted(before[0], count)
        if abs(counts) < LEAST_COUNTS or shown == before[1] or not scale.units_per_motor_turn:
            show_refusal(
                t("{counts:.0f} counts say nothing of the scale", counts=counts),
                t("move the axis further, or see 608Fh and 6092h"),
            )
            return
        by_move = compared(counts / scale.units_per_motor_turn, shown - before[1], moved)
        self._said.set_text(
            t(
                "{counts:.0f} counts, {turns:.4f} turns of the motor: {shown:.4f} by the machine file, "
                "{moved:g} measured",
                counts=counts,
                turns=by_move.motor_turns,
                shown=by_move.shown,
                moved=moved,
            )
        )
        lines = []
        if abs(by_move.error) > ACCURACY:
            lines = [f"units_per_motor_rev = {by_move.per_turn:.6g}   # in [[axis]]"]
        verdict = (
            t("the machine file fits")
            if by_move.fits
            else t("the motor turns against the machine file: turn `invert` in [axis.drive] round")
            if by_move.reversed
            else t("the machine file does not fit: change it so")
        )
        self._show(f"<p>{html.escape(verdict)}</p>", lines)

    async def _place(self) -> tuple[DriveScale, int, float] | None:
        """Return the drive's scale, its count, and where the machine shows the axis; None: it was refused."""

        def ask(desk: Desk) -> tuple[DriveScale, int | None]:
            return scale_of(desk), desk.read_number(POSITION[0] + desk.drive.offset)

        drive = self._drive.chosen()
        found = None if drive is None else await self._drive.read(ask)
        if drive is None or found is None:
            return None
        if found[1] is None:
            show_refusal(t("6064h cannot be read"), t("see its EDS"))
            return None
        try:
            axes = (await self._drive.actions.link.connected().status()).axes
        except MotionError as error:
            show_error(error)
            return None
        return found[0], found[1], axes.position[axes.index.index(drive.axis)]

    def _show(self, content: str, lines: list[str]) -> None:
        written = f"<pre>{html.escape(chr(10).join(lines))}</pre>" if lines else ""
        self._report.set_content(content + written)


def _ratio(ratio: tuple[int, int] | None) -> str:
    return "–" if ratio is None else f"{ratio[0]}, {ratio[1]}"
