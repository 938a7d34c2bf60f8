"""Parameters of a drive by the names of its EDS: searched, read, written within limits, stored."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from mcserver.canopen.canopen_errors import DriveError, object_text
from mcserver.canopen.desk import Desk, Reading
from mcserver.canopen.parameters import Parameter, encode, search
from mcserver.errors import UsageFault
from mcserver.web.actions import show_error
from mcserver.web.panels.card import card
from mcserver.web.panels.desk_drive import DeskDrive
from mcserver.web.panels.kept_rows import KeptRows
from mcserver.web.translation import mark, t

# rows at a time: who wants others gives more words
SHOWN = 40


class ParametersPanel:
    """What words find, each with the value that was read last; one of them to be written."""

    def __init__(self, drive: DeskDrive) -> None:
        self._drive = drive
        self._values: dict[Parameter, str] = {}
        self._shown: list[Parameter] = []
        self._chosen: Parameter | None = None
        with card(t("Parameters")):
            self._words = (
                ui.input(t("Search: words of names, numbers, types"), on_change=self._search)
                .props("dense clearable debounce=200")
                .classes("w-full")
            )
            with ui.element("div").classes("w-full mc-chosen") as self._one:
                self._title = ui.label("").classes("font-bold break-words")
                self._limits = ui.label("").classes("text-xs")
                with ui.row().classes("w-full items-center gap-2"):
                    self._value = ui.input(t("Value")).props("dense").classes("grow min-w-24")
                    self._value.on("keydown.enter", self._write)
                    ui.button(t("Read"), on_click=self._read_one).props("outline")
                    self._write_button = ui.button(t("Write"), on_click=self._write).props("color=warning")
            self._said = ui.label("").classes("text-sm break-words").props("role=status")
            with ui.element("div").classes("mc-buttons"):
                ui.button(t("Read what is shown"), on_click=self._read_shown).props("outline")
                ui.button(t("Save in the drive"), on_click=self._save).props("outline")
            self._count = ui.label("").classes("text-xs")
            self._rows = KeptRows(self._row)
        self._one.set_visibility(False)
        drive.on_change(self._on_drive)

    def _on_drive(self) -> None:
        """Begin with another drive's parameters; values of the one before are not its."""
        self._values.clear()
        self._said.set_text("")
        self._choose(None)
        self._search()

    def _search(self) -> None:
        found = search(self._drive.parameters, str(self._words.value or "").split())
        self._shown = found[:SHOWN]
        self._count.set_text(
            t("{shown} of {count} parameters are shown", shown=len(self._shown), count=len(found))
            if len(found) > SHOWN
            else t("{count} parameters", count=len(found))
        )
        self._rows.show({each: self._values.get(each, "") for each in self._shown})

    def _row(self, parameter: Parameter) -> ui.label:
        with ui.row().classes("w-full items-center justify-between gap-x-2 gap-y-0 mc-row"):
            ui.button(parameter.title, on_click=partial(self._take, parameter)).props(
                "flat dense no-caps align=left"
            ).classes("min-w-0 break-words text-left")
            with ui.row().classes("items-center gap-2 ml-auto"):
                ui.label(f"{parameter.type} {parameter.access}").classes("text-xs whitespace-nowrap")
                return ui.label("").classes("font-mono break-all")

    def _choose(self, parameter: Parameter | None) -> None:
        self._chosen = parameter
        self._one.set_visibility(parameter is not None)
        if parameter is None:
            return
        self._title.set_text(parameter.title)
        low, high = ("…" if limit is None else str(limit) for limit in (parameter.low, parameter.high))
        bounded = (parameter.low, parameter.high) not in ((None, None), (0, 0))
        within = t("{low} to {high} by the EDS", low=low, high=high) if bounded else ""
        self._limits.set_text(", ".join(filter(None, [parameter.type, parameter.access, within])))
        self._write_button.set_visibility(parameter.writable)
        self._value.set_value("")

    async def _take(self, parameter: Parameter) -> None:
        self._choose(parameter)
        if parameter.readable:
            await self._read_one()

    async def _read_one(self) -> None:
        chosen, before = self._chosen, self._value.value
        if chosen is not None:
            reading = await self._drive.read(lambda desk: desk.read(chosen))
            if reading is not None:
                self._show([reading], before)

    async def _read_shown(self) -> None:
        wanted, before = [each for each in self._shown if each.readable], self._value.value

        def read(desk: Desk) -> list[Reading | tuple[Parameter, str]]:
            found: list[Reading | tuple[Parameter, str]] = []
            for each in wanted:
                try:
                    found.append(desk.read(each))
                except DriveError as error:
                    if error.code != "MC553":
                        raise
                    found.append((each, error.message))
            return found

        found = await self._drive.read(read)
        if found is not None:
            self._show([each for each in found if isinstance(each, Reading)], before)
            refused = [each for each in found if not isinstance(each, Reading)]
            for parameter, why in refused:
                self._values[parameter] = "–"
                self._said.set_text(why)
            self._search()

    async def _write(self) -> None:
        chosen, before = self._chosen, self._value.value
        value = str(before or "").strip()
        if chosen is None:
            return
        try:
            # what cannot be meant is refused before anything is asked
            encode(chosen, value)
        except UsageFault as error:
            show_error(error)
            return
        reading = await self._drive.write(
            mark("write {parameter} = {value}", parameter=chosen.title, value=value),
            lambda desk: desk.write(chosen, value),
        )
        if reading is not None:
            self._show([reading], before)
            self._said.set_text(
                t(
                    "{parameter} is {value}: kept until the drive is switched off, unless it is saved",
                    parameter=object_text(*chosen.place),
                    value=reading.value,
                )
            )

    async def _save(self) -> None:
        def save(desk: Desk) -> bool:
            desk.save()
            return True

        if await self._drive.write(mark("save the drive's parameters (1010h)"), save):
            self._said.set_text(t("the drive has stored its parameters"))

    def _show(self, readings: list[Reading], before: object) -> None:
        """Show readings, the chosen parameter's in the field too, unless somebody has typed there meanwhile.

        Args:
            before: what the field held as they were asked for.
        """
        for each in readings:
            self._values[each.parameter] = value_text(each)
            if each.parameter is self._chosen and self._value.value == before:
                self._value.set_value(str(each.value))
        self._rows.show({each: self._values.get(each, "") for each in self._shown})


def value_text(reading: Reading) -> str:
    """Return a value as it is shown; numbers in hexadecimal, too."""
    if isinstance(reading.value, int) and not isinstance(reading.value, bool) and reading.kind != "bytes":
        return f"{reading.value} · {reading.raw[::-1].hex()}h"
    return str(reading.value)
