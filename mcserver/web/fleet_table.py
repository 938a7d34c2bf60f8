"""The fleet's table: its columns, its words, and the row of a machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mcserver.web.fleet import Seen
from mcserver.web.formatting import banner, current_program, is_live, remaining_text
from mcserver.web.jobs import JobQueue
from mcserver.web.machine_words import program_name
from mcserver.web.translation import mark, t

# a link for the keyboard and the finger; text alone, whatever a machine is called
LINK = """(params) => {
  const link = document.createElement("a");
  link.href = "/machine/" + encodeURIComponent(params.value);
  link.textContent = params.value;
  return link;
}"""
# what runs, with the picture that its slicer has put into it
PROGRAM = """(params) => {
  const shown = document.createElement("span"), job = params.data.job;
  if (job !== null) {
    const picture = document.createElement("img");
    picture.className = "mc-icon";
    picture.alt = "";
    picture.src = "/machine/" + encodeURIComponent(params.data.machine) + "/jobs/" + job + "/picture";
    shown.append(picture, " ");
  }
  shown.append(params.value ?? "");
  return shown;
}"""
# what an operator looks for first comes first: a phone shows three columns without scrolling
COLUMNS: list[dict[str, Any]] = [
    # what is wrong comes first; rows do not move for what comes and goes
    {"field": "rank", "hide": True, "sort": "asc", "sortIndex": 0},
    {
        "field": "machine",
        "headerName": mark("Machine"),
        "pinned": "left",
        "checkboxSelection": True,
        # all that are looked for
        "headerCheckboxSelection": True,
        "headerCheckboxSelectionFilteredOnly": True,
        ":cellRenderer": LINK,
        "sort": "asc",
        "sortIndex": 1,
        "minWidth": 140,
        "maxWidth": 320,
    },
    {
        "field": "state",
        "headerName": mark("State"),
        "filter": True,
        "minWidth": 110,
        "flex": 1.5,
        ":cellClass": "(params) => 'mc-cell-' + (params.data.kind ?? 'offline')",
    },
    {"field": "percent", "headerName": "%", "minWidth": 70},
    {"field": "remaining", "headerName": mark("Time left"), "minWidth": 105},
    {
        "field": "program",
        "headerName": mark("Program"),
        "minWidth": 160,
        "flex": 2,
        ":cellRenderer": PROGRAM,
        # the picture may come behind the name
        ":equals": "() => false",
    },
    {"field": "waiting", "headerName": mark("Waiting"), "minWidth": 95},
    {"field": "faults", "headerName": mark("Faults"), "minWidth": 200, "flex": 3},
    {"field": "today", "headerName": mark("Today %"), "minWidth": 100},
    {"field": "late", "headerName": mark("Late cycles"), "minWidth": 115},
    {"field": "group", "headerName": mark("Group"), "filter": True, "minWidth": 110},
    {"field": "tags", "headerName": mark("Tags"), "filter": True, "minWidth": 110},
]


# of the kinds of states that are wrong; then programs that have failed; all others are alike
RANKS = {"estop": 0, "fault": 1, "offline": 2}
FAILED_RANK = 3
STATES = (
    mark("ready"),
    mark("moving"),
    mark("running"),
    mark("held"),
    mark("paused"),
    mark("fault"),
    mark("EMERGENCY STOP"),
    mark("offline"),
)
# what the table itself says
GRID_TEXTS = {
    "noRowsToShow": mark("no machines"),
    "noMatchingRows": mark("no machine matches"),
    "filterOoo": mark("Search"),
    "contains": mark("contains"),
    "notContains": mark("does not contain"),
    "equals": mark("is"),
    "notEqual": mark("is not"),
    "startsWith": mark("begins with"),
    "endsWith": mark("ends with"),
    "blank": mark("is empty"),
    "notBlank": mark("is not empty"),
    "andCondition": mark("and"),
    "orCondition": mark("or"),
    # to who cannot see it
    "ariaRowToggleSelection": mark("tick with Space"),
    "ariaRowSelectAll": mark("tick all that match with Space"),
    "ariaHeaderSelection": mark("column with a box for all"),
    "ariaChecked": mark("ticked"),
    "ariaUnchecked": mark("not ticked"),
    "ariaIndeterminate": mark("some ticked"),
    "ariaSortableColumn": mark("Enter sorts"),
    "ariaFilterColumn": mark("Ctrl+Enter filters"),
    "ariaLabelColumnFilter": mark("filter of the column"),
    "ariaFilteringOperator": mark("how to compare"),
    "ariaFilterValue": mark("what to look for"),
}


def grid_options(filters: dict[str, Any], search: str) -> dict[str, Any]:
    """Return what the table is made with, in the language of the page.

    Args:
        filters: of its columns, as the table takes them. search: a text anywhere in a row.
    """
    return {
        "columnDefs": [_in_words(column) for column in COLUMNS],
        "localeText": {key: t(text) for key, text in GRID_TEXTS.items()},
        "defaultColDef": {"sortable": True, "flex": 1},
        "rowData": [],
        "rowSelection": "multiple",
        "suppressRowClickSelection": True,
        "animateRows": False,
        ":getRowId": "(params) => params.data.machine",
        "quickFilterText": search,
        "initialState": {"filter": {"filterModel": filters}},
    }


def _in_words(column: dict[str, Any]) -> dict[str, Any]:
    return {**column, "headerName": t(column["headerName"])} if "headerName" in column else column


def group_of(name: str) -> str:
    """Return a machine's group: its name before the last ``-`` or ``.``, as ``hall-2`` of ``hall-2-07``."""
    cut = max(name.rfind("-"), name.rfind("."))
    return name[:cut] if cut > 0 else ""


def machine_row(seen: Seen, running_today: Mapping[str, float], jobs: JobQueue | None) -> dict[str, Any]:
    """Return what the table shows of a machine.

    Args:
        running_today: share of the day in which a program ran, by machine [%]. jobs: of this page, if any.
    """
    status = seen.status
    word, kind = banner(status, seen.online)
    program = current_program(status) if seen.online else None
    live = program is not None and is_live(program)
    faults = [] if status is None else [f"{fault.code} {t(fault.message)}" for fault in status.faults]
    failed = None if jobs is None or not seen.online else jobs.failed(program)
    if failed is not None:
        faults.append(f"{program_name(failed.name)}: {t(failed.message)}")
    if jobs is not None and jobs.stopped and jobs.waiting:
        faults.append(t("the queue is stopped"))
    # of what runs, where it is a program of this page; the programs of others have no pictures
    job = None if jobs is None or program is None else jobs.running
    pictured = live and job is not None and program is not None and job.program == program.program
    return {
        "machine": seen.name,
        "rank": RANKS.get(kind, FAILED_RANK + (failed is None)),
        "group": seen.group or group_of(seen.name),
        "tags": " ".join(seen.tags),
        "state": t(word),
        "kind": kind,
        "program": program_name(program.name or program.program) if program is not None and live else "",
        "job": job.number if job is not None and pictured and job.thumbnail is not None else None,
        "waiting": len(jobs.waiting) or None if jobs is not None else None,
        "percent": round(100 * program.progress) if program is not None and live else None,
        "remaining": remaining_text(program) if program is not None and live else "",
        "faults": "; ".join(faults),
        "today": running_today.get(seen.name),
        "late": status.late_cycles if status is not None else None,
    }
