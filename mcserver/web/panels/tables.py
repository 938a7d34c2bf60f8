"""Work offsets and tools as tables that people edit: each change is shown as the line that it is."""

from __future__ import annotations

import html
import time
from collections.abc import Sequence
from typing import Any

from mcclient import Info, Machine, MotionError
from mcclient.broken_off import WORK_OFFSET
from mcclient.types import Tables, ToolRow
from mcclient.work_tables import (
    SYSTEMS,
    change_text,
    offset_line,
    tool_line,
    undo_line,
    undo_row,
    use_text,
)
from nicegui import ui

from mcserver.web.actions import Actions, show_error, show_refusal
from mcserver.web.dialogs import NamedDialog, answer_to, answers, ask
from mcserver.web.formatting import MOST, axis_name, position_text
from mcserver.web.machine_words import program_name
from mcserver.web.open_programs import refusal_of, refusal_text, run_at_rest
from mcserver.web.panels.card import card, scrolled
from mcserver.web.translation import mark, t

PERIOD_S = 1.0
CHANGES_SHOWN = 12
# of a system that is turned about Z, as its word in G10 L2
ANGLE = "R"
WHY = mark("tables are changed at rest")


class TablesPanel:
    """Hidden on machines whose programs have no work offsets."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._tables: Tables | None = None
        self._info: Info | None = None
        with card(t("Offsets and tools")) as self._card:
            self._rows = scrolled(t("Offsets and tools"))
            with ui.element("div").classes("mc-buttons"):
                offset = ui.button(t("Change an offset …"), on_click=self._ask_offset).props("outline dense")
                self._tool = ui.button(t("Change a tool …"), on_click=self._ask_tool).props("outline dense")
                self._undo = ui.button(t("Undo …"), on_click=self._ask_undo).props("outline dense")
            self._buttons = (offset, self._tool, self._undo)
            self._waits_for = ui.label("").classes("text-sm").props("aria-live=polite")
        self._card.set_visibility(False)

    async def update(self, info: Info) -> None:
        link = self._actions.link
        machine, status = link.machine, link.status
        if not link.has_work_offsets:
            self._card.set_visibility(False)
        if machine is None or status is None or not link.has_work_offsets:
            return
        try:
            self._tables = await link.answers.get("tables", PERIOD_S, machine.tables)
        except MotionError as error:
            self._rows.set_content(f"<p>{html.escape(t(error.message))} [{error.code}]</p>")
            for button in self._buttons:
                button.set_enabled(False)
            self._card.set_visibility(True)
            return
        self._info = info
        self._rows.set_content(tables_html(self._tables, info))
        self._tool.set_visibility(self._tables.tool_table)
        # not before: a button that is seen has to do something
        self._card.set_visibility(True)
        refusal = refusal_of(link, status.programs, WHY)
        self._waits_for.set_text(refusal_text(refusal))
        for button in self._buttons:
            button.set_enabled(refusal is None)
        if refusal is None:
            self._undo.set_enabled(bool(self._tables.changes))

    async def _send(self, what: str, line: str) -> bool:
        async def send(machine: Machine) -> None:
            name = f"{WORK_OFFSET} by {self._actions.visitor.name}"
            await run_at_rest(self._actions.link, machine, name, line, WHY)

        done = await self._actions.do("open", what, send)
        self._actions.link.answers.forget("tables")
        return done

    async def _ask_offset(self) -> None:
        tables = self._tables
        if not self._actions.allowed("open") or tables is None or self._info is None:
            return
        shows = tables
        with NamedDialog(t("Change a work offset")) as dialog, ui.card().classes("mc-ask"):
            ui.label(t("Where programs read zero. Nothing moves."))
            system = ui.select(
                {each: f"{each} {shows.names.get(each, '')}".strip() for each in SYSTEMS},
                value="G54",
                label=t("System"),
            ).classes("min-w-28")
            way = ui.select({False: t("set to"), True: t("shift by")}, value=False, label=t("How"))
            with ui.element("div").classes("mc-buttons"):
                fields = {
                    str(axis.index): ui.number(
                        f"{axis_name(axis.index)} [{axis.unit}]", min=-MOST, max=MOST, format="%.4f"
                    ).classes("w-28")
                    for axis in self._info.axes
                }
                fields[ANGLE] = ui.number(t("Angle R [deg]"), min=-360.0, max=360.0, format="%.4f").classes(
                    "w-28"
                )
            name = ui.input(t("Name"), value=shows.names.get("G54", "")).props("maxlength=60")
            line = ui.label("").classes("font-mono break-all").props(f'aria-label="{t("line to be sent")}"')

            def shown() -> dict[Any, Any]:
                origin = {} if way.value else _origin(shows, system.value)
                places = {field: round(origin.get(axis, 0.0), 6) for axis, field in fields.items()}
                return {**places, name: shows.names.get(system.value, "")}

            def fill() -> None:
                # an angle is set, never shifted
                fields[ANGLE].set_visibility(not way.value)
                _fill(shown())
                write()

            def write() -> None:
                origin = _origin(shows, system.value)
                # where it would be: what G10 L2 does under G91 depends on the controller, and is refused
                places = {
                    axis: field.value + (origin.get(axis, 0.0) if way.value else 0.0)
                    for axis, field in fields.items()
                    if field.value is not None and not (way.value and axis == ANGLE)
                }
                changed = {
                    axis: place for axis, place in places.items() if abs(place - origin.get(axis, 0.0)) > 5e-7
                }
                line.set_text(offset_line(system.value, changed) if changed else "")

            for field in (system, way):
                field.on_value_change(fill)
            for number in fields.values():
                number.on_value_change(write)
            fill()
            answers(dialog, t("Set"))

        async def change(_: bool) -> bool:
            nonlocal shows
            newest = await self._newest(shows)
            if newest is None:
                return False
            if newest is not shows:
                typed = _typed(shown())
                shows = newest
                _fill(shown(), but=typed)
                write()
                return False
            return await self._change(system.value, line.text, name=name.value or "")

        await answer_to(dialog, change)

    async def _ask_tool(self) -> None:
        tables = self._tables
        if not self._actions.allowed("open") or tables is None:
            return
        shows = tables
        with NamedDialog(t("Change a tool")) as dialog, ui.card().classes("mc-ask"):
            ui.label(t("Length for G43 and diameter. A G43 before does not see the change."))
            number = ui.number(
                t("Tool"),
                value=min((each.number for each in shows.tools), default=1),
                min=1,
                max=99999,
                format="%d",
            )
            length = ui.number(t("Length [mm]"), min=-MOST, max=MOST, format="%.4f")
            diameter = ui.number(t("Diameter [mm]"), min=0.0, max=MOST, format="%.4f")
            name = ui.input(t("Name")).props("maxlength=60")
            life = ui.number(t("Life [min], 0: no limit"), min=0.0, max=MOST, format="%g")
            with ui.row().classes("items-center"):
                used = ui.number(t("Has cut [min]"), min=0.0, max=MOST, format="%g")
                ui.button(t("A new one is fitted"), on_click=lambda: used.set_value(0.0)).props(
                    "outline dense"
                )
            line = ui.label("").classes("font-mono break-all").props(f'aria-label="{t("line to be sent")}"')

            def shown() -> dict[Any, Any]:
                tool = _tool(shows, number.value)
                return {
                    length: None if tool is None else round(tool.length, 6),
                    diameter: 0.0 if tool is None else round(tool.diameter, 6),
                    name: "" if tool is None else tool.name,
                    life: 0.0 if tool is None else tool.life_min,
                    used: shown_use(tool),
                }

            def fill() -> None:
                _fill(shown())
                write()

            def write() -> None:
                known = number.value and length.value is not None and diameter.value is not None
                tool = _tool(shows, number.value)
                same = (
                    known
                    and tool is not None
                    and abs(tool.length - length.value) < 5e-7
                    and abs(tool.diameter - diameter.value) < 5e-7
                )
                line.set_text(
                    tool_line(int(number.value), length.value, diameter.value) if known and not same else ""
                )

            number.on_value_change(fill)
            length.on_value_change(write)
            diameter.on_value_change(write)
            fill()
            answers(dialog, t("Set"))

        async def change(_: bool) -> bool:
            nonlocal shows
            newest = None if not number.value else await self._newest(shows)
            if newest is None:
                return False
            if newest is not shows:
                typed = _typed(shown())
                shows = newest
                _fill(shown(), but=typed)
                write()
                return False
            tool = _tool(shows, number.value)
            # it may have cut meanwhile: what nobody has touched is not set
            same = used.value is None or used.value == shown_use(tool)
            return await self._change(
                f"T{int(number.value)}",
                line.text,
                name=name.value or "",
                life_min=life.value or 0.0,
                used_min=None if same else used.value,
            )

        await answer_to(dialog, change)

    async def _newest(self, shown: Tables) -> Tables | None:
        """Return the tables; those that a dialog shows where nobody has changed them since, else it is said.

        None: they are not known now, which is said, too.
        """
        try:
            newest = await self._actions.link.connected().tables()
        except MotionError as error:
            show_error(error)
            return None
        if newest.changes[:1] == shown.changes[:1]:
            return shown
        show_refusal(t("The tables have been changed meanwhile"), t("look at them, then change them again"))
        return newest

    async def _change(
        self,
        row: str,
        line: str,
        *,
        name: str,
        life_min: float | None = None,
        used_min: float | None = None,
    ) -> bool:
        """Send a line, where there is one, and what else the server keeps of the row; whether all was done.

        The line is the last change, and so the one that *Undo* takes back; a new tool is put in by it first.
        """
        new = row not in SYSTEMS and all(row != f"T{tool.number}" for tool in self._known_tools)
        if line and new and not await self._send(f"{row}: {line}", line):
            return False
        what = mark("{row}: name and life", row=row)
        done = await self._set_row(what, row=row, name=name, life_min=life_min, used_min=used_min)
        if done and line and not new:
            done = await self._send(f"{row}: {line}", line)
        if done:
            ui.notify(t("{row} is changed", row=row), position="bottom")
        return done

    @property
    def _known_tools(self) -> tuple[ToolRow, ...]:
        return () if self._tables is None else self._tables.tools

    async def _set_row(self, what: str, **changes: Any) -> bool:
        async def send(machine: Machine) -> None:
            await machine.set_table_row(**changes, by=self._actions.visitor.name)

        done = await self._actions.do("set_table_row", what, send)
        self._actions.link.answers.forget("tables")
        return done

    async def _ask_undo(self) -> None:
        tables = self._tables
        if not self._actions.allowed("open") or tables is None or not tables.changes:
            return
        last = tables.changes[0]
        line, back = undo_line(last), undo_row(last)
        if line is None and back is None:
            show_refusal(
                t("{row} was not in the table before", row=last.row), t("change it, or leave it there")
            )
            return

        async def undo() -> bool:
            newest = await self._newest(tables)
            if newest is not tables:
                # the question was about a change that is not the last one any more
                return newest is not None
            what = mark("undo {change}", change=change_text(last))
            return await (self._send(what, line or "") if back is None else self._set_row(what, **back))

        await ask(
            t("Take the last change back? {change}", change=change_text(last)),
            t("Undo"),
            colour="warning",
            details=lambda: ui.label(line or "").classes("font-mono break-all"),
            act=undo,
        )


def _typed(shown: dict[Any, Any]) -> list[Any]:
    """Return the fields of a dialog that somebody has given another value than it shows."""
    return [field for field, value in shown.items() if field.value != value]


def _fill(shown: dict[Any, Any], but: Sequence[Any] = ()) -> None:
    """Give fields what a dialog shows, but those with what was typed: the rest would be set back by it."""
    for field, value in shown.items():
        if field not in but:
            field.set_value(value)


def _origin(tables: Tables, system: str) -> dict[str, float]:
    found = (each for each in tables.offsets if each.system == system)
    return next(({**each.origin, ANGLE: each.rotation} for each in found), {})


def _tool(tables: Tables, number: float | None) -> ToolRow | None:
    return next((each for each in tables.tools if each.number == int(number or 0)), None)


def shown_use(tool: ToolRow | None) -> float:
    """Return for how long a tool has cut, as it is shown [min]."""
    return 0.0 if tool is None else round(tool.used_min, 1)


def tables_html(tables: Tables, info: Info) -> str:
    """Return systems, tools and the newest changes as HTML; what was never set or named is left out."""
    names = tables.names
    origins = {each.system: each.origin for each in tables.offsets}
    turned = any(each.rotation for each in tables.offsets)
    angles = {each.system: each.rotation for each in tables.offsets}
    head = "".join(f"<th class=n>{axis_name(axis.index)} [{axis.unit}]</th>" for axis in info.axes)
    head += f"<th class=n>{t('Angle R [deg]')}</th>" * turned
    rows = "".join(
        f"<tr><td>{system}</td>"
        + "".join(
            f"<td class=n>{position_text(origins.get(system, {}).get(str(axis.index), 0.0))}</td>"
            for axis in info.axes
        )
        + f"<td class=n>{position_text(angles.get(system, 0.0))}</td>" * turned
        + f"<td>{html.escape(names.get(system, ''))}</td></tr>"
        for system in SYSTEMS
        if system == SYSTEMS[0] or system in origins or system in names
    )
    parts = [_table(f"<th>{t('System')}</th>{head}<th>{t('Name')}</th>", rows)]
    if tables.tools:
        rows = "".join(
            f"<tr><td>T{tool.number}</td><td class=n>{position_text(tool.length)}</td>"
            f"<td class=n>{position_text(tool.diameter)}</td>"
            f"<td>{html.escape(tool.name)}</td><td class=n>{_use_html(tool)}</td></tr>"
            for tool in tables.tools
        )
        titles = f"<th class=n>{t('Length [mm]')}</th><th class=n>{t('Diameter [mm]')}</th>"
        titles += f"<th>{t('Name')}</th><th class=n>{t('Has cut [min]')}</th>"
        parts.append(_table(f"<th>{t('Tool')}</th>{titles}", rows))
    if tables.changes:
        lines = "".join(
            f"<div>{time.strftime('%d.%m. %H:%M:%S', time.localtime(each.wall))} "
            f"<b>{html.escape(program_name(each.name or each.client))}</b>"
            f" {html.escape(change_text(each))}</div>"
            for each in tables.changes[:CHANGES_SHOWN]
        )
        parts.append(f'<p>{t("Changes:")}</p><div class="text-sm">{lines}</div>')
    return "".join(parts)


def _use_html(tool: ToolRow) -> str:
    if not 0.0 < tool.life_min <= tool.used_min:
        return use_text(tool)
    return f'<b class="text-negative">{use_text(tool)} · {t("used up")}</b>'


def _table(head: str, rows: str) -> str:
    return f'<table class="mc-positions"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
