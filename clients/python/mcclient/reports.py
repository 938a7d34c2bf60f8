"""What happens to one program's lines: events, one line at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from mcclient.events import FetchPage, open_events
from mcclient.feed import Feed, Queue
from mcclient.transport import Link
from mcclient.types import Diagnostic, Event, Fault, LineReport

ReportKind = Literal["started", "ended", "rejected", "program", "fault", "warning"]


@dataclass(frozen=True, slots=True)
class Report:
    """One thing that happened.

    Attributes:
        kind: ``started`` and ``ended`` of a line, ``rejected`` with diagnostics, ``program`` for a change of
            state, ``fault``, ``warning``.
        line: the line concerned; 0: none. For ``started`` the last one that has started.
        t: executor time [s].
        timing: for ``ended``: requested and actual time, and what bound it.
    """

    kind: ReportKind
    line: int
    t: float
    state: str | None = None
    timing: LineReport | None = None
    fault: Fault | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    message: str = ""


OpenReports = Callable[[str], Feed[Report]]


def reports_of(event: Event) -> list[Report]:
    """Return the reports that an event holds; none for events that concern no program."""
    if event.kind == "lines.started":
        return [Report("started", event.line, event.t)]
    if event.kind == "lines.ended":
        return [Report("ended", each.line, each.end_s, timing=each) for each in event.lines]
    if event.kind == "line.rejected":
        return [Report("rejected", event.line, event.t, diagnostics=event.diagnostics)]
    if event.kind == "fault":
        return [Report("fault", event.line, event.t, fault=event.fault)]
    if event.kind == "warning":
        return [Report("warning", event.line, event.t, message=event.message)]
    if event.kind.startswith("program."):
        return [
            Report("program", event.line, event.t, state=event.state, fault=event.fault, message=event.reason)
        ]
    return []


def open_reports(link: Link, key: str, fetch: FetchPage, program: str) -> Feed[Report]:
    """Return a feed of one program's reports, which ends after the program has."""

    def take(queue: Queue[Report], event: Event) -> None:
        if event.program != program or queue.closed:
            return
        for report in reports_of(event):
            queue.push(report)
        if event.kind == "program.ended":
            queue.end()

    return open_events(link, key, fetch, take)
