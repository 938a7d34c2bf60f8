"""The page of all machines: a table that stays smooth with a thousand rows, and orders to several at once."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from mcserver.web.actions import show_refusal, show_role_refusal
from mcserver.web.dialogs import ask
from mcserver.web.fleet import Fleet, Seen
from mcserver.web.formatting import banner, current_program, is_live, remaining_text
from mcserver.web.menu import add_menu
from mcserver.web.sessions import Visitor

REFRESH_S = 1.0
# a link for the keyboard and the finger; text alone, whatever a machine is called
LINK = """(params) => {
  const link = document.createElement("a");
  link.href = "/machine/" + encodeURIComponent(params.value);
  link.textContent = params.value;
  return link;
}"""
# what an operator looks for first comes first: a phone shows three columns without scrolling
COLUMNS: list[dict[str, Any]] = [
    {
        "field": "machine",
        "pinned": "left",
        "checkboxSelection": True,
        ":cellRenderer": LINK,
        "sort": "asc",
        "minWidth": 140,
        "maxWidth": 320,
    },
    {
        "field": "state",
        "minWidth": 95,
        ":cellClass": "(params) => 'mc-cell-' + (params.data.kind ?? 'offline')",
    },
    {"field": "percent", "headerName": "%", "minWidth": 70},
    {"field": "remaining", "headerName": "Time left", "minWidth": 105},
    {"field": "program", "minWidth": 160, "flex": 2},
    {"field": "faults", "minWidth": 200, "flex": 3},
    {"field": "late", "headerName": "Late cycles", "minWidth": 115},
    {"field": "group", "filter": True, "minWidth": 110},
]


class FleetPage:
    """One browser's view of the fleet; only rows that have changed are sent."""

    def __init__(self, visitor: Visitor, fleet: Fleet) -> None:
        self._visitor = visitor
        self._fleet = fleet
        self._sent: dict[str, dict[str, Any]] = {}
        with ui.header(elevated=True).classes("items-center justify-between no-wrap py-1 px-2 bg-slate-900"):
            ui.label("Machines").classes("font-bold text-lg")
            self._summary = ui.label("").props("role=status")
            add_menu(visitor)
        with ui.element("div").classes("w-full p-2"):
            ui.html("<h1 class='sr-only'>Machines</h1>", sanitize=False)
            with ui.row().classes("items-center w-full"):
                self._search = (
                    ui.input("Search", on_change=self._filter).props("dense clearable").classes("grow")
                )
                self._group = ui.select(
                    {"": "all groups"}, value="", label="Group", on_change=self._filter_group
                ).classes("min-w-32")
                ui.button("Hold selected", on_click=lambda: self._ask("hold")).props("color=warning")
                ui.button("Stop selected", on_click=lambda: self._ask("abort")).props(
                    "color=negative outline"
                )
            self._grid = ui.aggrid(
                {
                    "columnDefs": COLUMNS,
                    "defaultColDef": {"sortable": True, "flex": 1},
                    "rowData": [],
                    "rowSelection": "multiple",
                    "suppressRowClickSelection": True,
                    "animateRows": False,
                    ":getRowId": "(params) => params.data.machine",
                },
            ).classes("w-full mt-2 mc-fleet")
            self._grid.on(
                "cellDoubleClicked", lambda event: ui.navigate.to(f"/machine/{event.args['data']['machine']}")
            )
            with ui.row().classes("items-center"):
                self._open = ui.select([], label="Open machine", with_input=True, on_change=self._go).classes(
                    "min-w-48"
                )
        ui.timer(REFRESH_S, self.update)
        ui.timer(0.1, self.update, once=True)

    def update(self) -> None:
        """Send the rows that have changed."""
        if not self._visitor.is_known():
            ui.navigate.to("/login")
            return
        rows = {seen.name: _row(seen) for seen in self._fleet.machines.values()}
        added = [row for name, row in rows.items() if name not in self._sent]
        changed = [row for name, row in rows.items() if name in self._sent and row != self._sent[name]]
        removed = [{"machine": name} for name in self._sent if name not in rows]
        if added or changed or removed:
            self._grid.run_grid_method(
                "applyTransaction", {"add": added, "update": changed, "remove": removed}
            )
        if added or removed:
            self._open.set_options(sorted(rows))
            groups = sorted({str(row["group"]) for row in rows.values()} - {""})
            kept = self._group.value if self._group.value in groups else ""
            self._group.set_options({"": "all groups", **{group: group for group in groups}}, value=kept)
        self._sent = rows
        online = sum(seen.online for seen in self._fleet.machines.values())
        faults = sum(row["state"] in ("fault", "EMERGENCY STOP") for row in rows.values())
        self._summary.set_text(self._fleet.failure or f"{online} of {len(rows)} online, {faults} with faults")

    def _filter(self) -> None:
        self._grid.run_grid_method("setGridOption", "quickFilterText", self._search.value or "")

    def _filter_group(self) -> None:
        wanted = {"group": {"filterType": "text", "type": "equals", "filter": self._group.value}}
        self._grid.run_grid_method("setFilterModel", wanted if self._group.value else None)

    def _go(self) -> None:
        if self._open.value:
            ui.navigate.to(f"/machine/{self._open.value}")

    async def _ask(self, order: str) -> None:
        if not self._visitor.may(order):
            show_role_refusal(order)
            return
        rows = await self._grid.get_selected_rows()
        names = [row["machine"] for row in rows]
        if not names:
            show_refusal("No machine is selected", "tick the machines first")
            return
        verb = "Hold" if order == "hold" else "Stop"
        listed = ", ".join(names[:8]) + (" …" if len(names) > 8 else "")
        if await ask(f"{verb} {len(names)} machines: {listed}?", verb, colour="negative"):
            failures = await self._fleet.order(order, names)
            for name, message in failures.items():
                show_refusal(f"{name}: {message}")
            ui.notify(f"{len(names) - len(failures)} of {len(names)} machines: {order}", position="bottom")


def group_of(name: str) -> str:
    """Return a machine's group: its name before the last ``-`` or ``.``, as ``hall-2`` of ``hall-2-07``."""
    cut = max(name.rfind("-"), name.rfind("."))
    return name[:cut] if cut > 0 else ""


def _row(seen: Seen) -> dict[str, Any]:
    status = seen.status
    word, kind = banner(status, seen.online)
    program = current_program(status) if seen.online else None
    live = program is not None and is_live(program)
    return {
        "machine": seen.name,
        "group": group_of(seen.name),
        "state": word,
        "kind": kind,
        "program": (program.name or program.program) if program is not None and live else "",
        "percent": round(100 * program.progress) if program is not None and live else None,
        "remaining": remaining_text(program) if program is not None and live else "",
        "faults": "; ".join(f"{fault.code} {fault.message}" for fault in status.faults)
        if status is not None
        else "",
        "late": status.late_cycles if status is not None else None,
    }
