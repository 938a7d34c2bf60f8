"""The page of all machines: a table that stays smooth with a thousand rows, and orders to several at once."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

from mcclient import MotionError
from nicegui import events, ui

from mcserver.errors import McError
from mcserver.web.actions import show_refusal, show_role_refusal, was_late
from mcserver.web.choice import Choice
from mcserver.web.control import needs_control
from mcserver.web.dialogs import NamedDialog, answer_to, ask
from mcserver.web.fleet import VISITOR_LINKS, Fleet
from mcserver.web.fleet_table import STATES, grid_options, machine_row
from mcserver.web.menu import add_menu
from mcserver.web.resuming import outbox_of
from mcserver.web.sessions import Visitor
from mcserver.web.store import MAX_PROGRAM_BYTES
from mcserver.web.translation import mark, t

log = logging.getLogger(__name__)

REFRESH_S = 1.0
# of each part of an address
MOST_CHARACTERS = 200
# The machines that are ticked come with the click itself: a browser that is asked for them afterwards may
# answer too late, and a stop would be lost.
SELECTED = """() => emit(
  getElement(document.querySelector(".mc-fleet")).api.getSelectedRows().map((row) => row.machine))"""
# given to those that are selected, after a question: the verb, and how the button looks
ORDERS = {
    "hold": (mark("Hold"), "color=warning"),
    "abort": (mark("Stop"), "color=negative outline"),
    "reset": (mark("Reset"), "color=warning outline"),
}


class FleetFilter(NamedTuple):
    """What of the fleet is looked for; empty: all.

    Attributes:
        search: a text anywhere in the row. group: a group's name. state: one of ``STATES``.
    """

    search: str = ""
    group: str = ""
    state: str = ""

    @classmethod
    def of(cls, query: Mapping[str, str]) -> FleetFilter:
        """Return what an address asks for; a state that there is not is none."""
        search, group, state = (query.get(name, "")[:MOST_CHARACTERS] for name in cls._fields)
        return cls(search, group, state if state in STATES else "")


class FleetPage:
    """One browser's view of the fleet; only rows that have changed are sent."""

    def __init__(self, visitor: Visitor, fleet: Fleet, chosen: FleetFilter) -> None:
        self._visitor = visitor
        self._fleet = fleet
        self._sent: dict[str, dict[str, Any]] = {}
        with ui.header(elevated=True).classes("items-center justify-between no-wrap py-1 px-2 bg-slate-900"):
            ui.label(t("Machines")).classes("font-bold text-lg")
            self._summary = ui.label("").props("role=status").classes("mc-summary")
            with ui.row().classes("items-center no-wrap gap-0"):
                add_menu(visitor)
                ui.button(t("E-STOP all"), on_click=self._stop_all).props(
                    f'color=negative aria-label="{t("Emergency stop of all machines")}" data-estop'
                ).classes("mc-estop")
        with ui.element("div").classes("w-full p-2"):
            ui.html(f"<h1 class='sr-only'>{t('Machines')}</h1>", sanitize=False)
            with ui.row().classes("items-center w-full"):
                search = ui.input(t("Search"), value=chosen.search).props("dense clearable data-address")
                search.classes("grow")
                search.on("update:value", js_handler='(value) => mcLookFor("search", value)')
                self._group = Choice(_groups({chosen.group}), value=chosen.group, label=t("Group"))
                self._group.classes("min-w-32").on(
                    "update:model-value",
                    js_handler='({ value, label }) => mcLookFor("group", value ? label : "")',
                )
                words = {each: t(each or mark("all states")) for each in ("", *STATES)}
                ui.select(words, value=chosen.state, label=t("State")).classes("min-w-32").on(
                    "update:model-value",
                    js_handler="({ value, label }) => "
                    f'mcLookFor("state", {json.dumps(list(words))}[value], label)',
                )
            with ui.element("div").classes("mc-buttons mt-2"):
                for order, (verb, looks) in ORDERS.items():
                    button = ui.button(t("{verb} selected", verb=t(verb))).props(looks)
                    button.on("click", partial(self._ask, order), js_handler=SELECTED)
                    button.set_enabled(visitor.may(order))
                button = ui.button(t("Run on selected …")).props("outline")
                button.on("click", self._ask_run, js_handler=SELECTED)
                button.set_enabled(visitor.may("open"))
                # apart from the others, and without a question
                button = ui.button(t("E-STOP selected")).classes("ml-6")
                button.props(f'color=negative data-stop aria-label="{t("Emergency stop of the selected")}"')
                button.on("click", self._stop_selected, js_handler=SELECTED)
            self._grid = ui.aggrid(grid_options(_column_filters(chosen), chosen.search))
            self._grid.classes("w-full mt-2 mc-fleet")
            self._grid.on(
                "cellDoubleClicked", lambda event: ui.navigate.to(f"/machine/{event.args['data']['machine']}")
            )
            with ui.row().classes("items-center"):
                self._open = Choice([], label=t("Open machine"), with_input=True, on_change=self._go).classes(
                    "min-w-48"
                )
        ui.on("mc_key", self._on_key)
        outbox_of(ui.context.client).timer.start(visitor.is_known, {REFRESH_S: self.update})

    def update(self) -> None:
        """Send the rows that have changed."""
        rows = {
            name: machine_row(seen, self._fleet.running_today, self._fleet.jobs_of(name))
            for name, seen in self._fleet.machines.items()
        }
        added = [row for name, row in rows.items() if name not in self._sent]
        changed = [row for name, row in rows.items() if name in self._sent and row != self._sent[name]]
        removed = [{"machine": name} for name in self._sent if name not in rows]
        if added or changed or removed:
            self._grid.run_grid_method(
                "applyTransaction", {"add": added, "update": changed, "remove": removed}
            )
        if added or removed:
            self._open.set_options(sorted(rows))
        if added or changed or removed:
            # the one that is chosen stays, whichever machines are there at this moment
            groups = _groups({str(row["group"]) for row in rows.values()} | {str(self._group.value)})
            if self._group.options != groups:
                self._group.set_options(groups)
        self._sent = rows
        online = sum(seen.online for seen in self._fleet.machines.values())
        faults = sum(row["kind"] in ("fault", "estop") for row in rows.values())
        self._summary.set_text(
            self._fleet.failure
            or t(
                "{online} of {count} online, {faults} with faults",
                online=online,
                count=len(rows),
                faults=faults,
            )
        )

    def _go(self) -> None:
        if self._open.value:
            ui.navigate.to(f"/machine/{self._open.value}")

    async def _on_key(self, event: events.GenericEventArguments) -> None:
        if event.args.get("key") == "estop":
            await self._stop_all()

    async def _stop_all(self) -> None:
        """Every visitor may stop; those that do not answer are asked, too."""
        await self._emergency_stop(list(self._fleet.machines))

    async def _stop_selected(self, event: events.GenericEventArguments) -> None:
        names = self._selected(event)
        if names:
            await self._emergency_stop(names)

    async def _emergency_stop(self, names: list[str]) -> None:
        log.info("emergency stop of %d machines by %s", len(names), self._visitor.name)
        failures = await self._fleet.emergency_stop(names, f"by {self._visitor.name} on the fleet's page")
        if failures:
            show_refusal(
                t("no emergency stop confirmed by {names}", names=_listed(sorted(failures))),
                t("use their own emergency stops"),
            )
        done = len(names) - len(failures)
        ui.notify(
            t("{done} of {count} machines: emergency stop confirmed", done=done, count=len(names)),
            type="warning",
            position="bottom",
        )

    def _selected(self, event: events.GenericEventArguments) -> list[str]:
        """Return the machines that were ticked when a button was pressed; says so where there are none."""
        names = sorted(name for name in event.args if name in self._fleet.machines)
        if not names:
            show_refusal(t("No machine is selected"), t("tick the machines first"))
        return names

    def _allowed(self, method: str) -> bool:
        if not self._visitor.may(method):
            show_role_refusal(method)
            return False
        return not needs_control(method) or not was_late()

    async def _ask(self, order: str, event: events.GenericEventArguments) -> None:
        if not self._allowed(order):
            return
        names = self._selected(event)
        if not names:
            return
        verb = t(ORDERS[order][0])

        async def give() -> bool:
            # the role may have been taken away while the dialog was open
            return self._allowed(order) and self._tell(
                ORDERS[order][0], names, await self._fleet.order(order, names, self._visitor.name)
            )

        await ask(
            t("{verb} {count} machines: {names}?", verb=verb, count=len(names), names=_listed(names)),
            verb,
            colour="negative",
            act=give,
        )

    async def _ask_run(self, event: events.GenericEventArguments) -> None:
        if not self._allowed("open"):
            return
        names = self._selected(event)
        if len(names) > VISITOR_LINKS:
            show_refusal(
                t("{count} machines are selected", count=len(names)),
                t("run it on {count} at a time", count=VISITOR_LINKS),
            )
        elif names:
            with NamedDialog(t("Run on several machines")) as dialog, ui.card().classes("mc-ask"):
                ui.label(
                    t("Run on {count} machines: {names}", count=len(names), names=_listed(names))
                ).classes("font-bold break-words")
                text = (
                    ui.textarea(label=t("G-code"))
                    .classes("w-full font-mono")
                    .props("autogrow spellcheck=false")
                )
                file: list[tuple[str, bytes]] = []
                ui.upload(
                    label=t("or a file, which each of them keeps"),
                    auto_upload=True,
                    max_files=1,
                    max_file_size=MAX_PROGRAM_BYTES,
                    on_upload=partial(_take, file, text),
                ).classes("w-full").props("flat bordered")
                ui.label(
                    t("It is checked at each machine, and waits where programs of this page run or wait.")
                )
                with ui.element("div").classes("mc-buttons"):
                    ui.button(t("Run"), on_click=lambda: dialog.submit(text.value)).props("color=positive")
                    ui.button(t("Cancel"), on_click=lambda: dialog.submit(None)).props("flat")

            async def run(chosen: str) -> bool:
                if not (chosen or file) or not self._allowed("open"):
                    return False
                failures = await self._fleet.run(names, chosen, self._visitor.name, file[0] if file else None)
                return self._tell(mark("queued"), names, failures)

            await answer_to(dialog, run)

    def _tell(self, what: str, names: list[str], failures: dict[str, BaseException]) -> bool:
        """Say what was done at how many machines, and why not at the others; whether at any."""
        log.info("%s: %d machines by %s", what, len(names), self._visitor.name)
        alike: dict[tuple[str, str], list[str]] = {}
        for name, error in failures.items():
            alike.setdefault(_said(error), []).append(name)
        for (message, hint), refused in alike.items():
            show_refusal(f"{_listed(refused)}: {message}", hint)
        ui.notify(
            t(
                "{done} of {count} machines: {what}",
                done=len(names) - len(failures),
                count=len(names),
                what=t(what),
            ),
            position="bottom",
        )
        return len(failures) < len(names)


async def _take(into: list[tuple[str, bytes]], text: ui.textarea, event: events.UploadEventArguments) -> None:
    """Keep an uploaded file, which goes in the place of what is typed."""
    into.append((event.file.name, await event.file.read()))
    text.set_visibility(False)


def _groups(names: set[str]) -> dict[str, str]:
    """Return the options of the list of groups."""
    return {"": t("all groups"), **{name: name for name in sorted(names - {""})}}


def _column_filters(chosen: FleetFilter) -> dict[str, Any]:
    """Return the filters of the columns as `mcLookFor` of page.js sets them: the words that are shown."""
    words = {"group": chosen.group, "state": t(chosen.state)}
    return {
        column: {"filterType": "text", "type": "equals", "filter": word}
        for column, word in words.items()
        if word
    }


def _said(error: BaseException) -> tuple[str, str]:
    """Return what an error says, and its remedy."""
    if isinstance(error, MotionError | McError):
        return f"{t(error.message)} [{error.code}]", error.hint
    return str(error) or type(error).__name__, ""


def _listed(names: list[str]) -> str:
    return ", ".join(names[:8]) + (" …" if len(names) > 8 else "")
