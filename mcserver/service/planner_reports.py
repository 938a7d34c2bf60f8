"""Apply the planner's events to the programs of a machine."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mcserver.errors import Diagnostic
from mcserver.planning.planner_messages import (
    Consumed,
    ContactAhead,
    Dropped,
    ExecutorEvents,
    FrameChanged,
    LineRejected,
    Planned,
    PlannerEvent,
    PlannerFailed,
    ProgramMessage,
    ToolsExchanged,
    Validated,
    WaitChanged,
)
from mcserver.service.program import Program
from mcserver.service.reports import Fault, wire_diagnostic

if TYPE_CHECKING:
    from mcserver.service.program_table import ProgramTable

# Interval for checking whether the programs of a planner that has ended are at rest.
AT_REST_S = 0.02


class PlannerReports:
    """Handles the planner's events for the programs of a table."""

    def __init__(self, table: ProgramTable) -> None:
        self._table = table
        self._loop = asyncio.get_running_loop()

    def take(self, events: Sequence[PlannerEvent]) -> None:
        for event in events:
            if isinstance(event, ExecutorEvents):
                for each in event.events:
                    self._table.executor.handle(each)
                continue
            if isinstance(event, PlannerFailed):
                self._planner_failed(event)
                continue
            if isinstance(event, Dropped):
                self._table.start(self._table.leases.forgotten(event.program))
                continue
            program = self._table.programs.get(event.program)
            if program is None or program.over:
                continue
            match event:
                case Consumed():
                    self._consumed(program, event)
                case FrameChanged():
                    before, program.frame = program.frame, event.frame
                    program.tool_use.behind(event.line, event.frame)
                    self._table.offsets.keep(
                        event.frame,
                        before=before,
                        wall=self._table.options.clock(),
                        client=program.client,
                        program=program.program,
                        name=program.name,
                    )
                    self._table.pauses.offsets_changed()
                case ToolsExchanged():
                    self._table.mounted = self._table.mounted.behind(event.exchange)
                    if event.exchange.fitted is not None:
                        self._table.offsets.fit(event.exchange.fitted)
                case ProgramMessage():
                    program.messages.append(event)
                case Planned():
                    program.progress.planned(event.reports)
                    program.tool_use.planned(event.reports)
                case Validated():
                    self._validated(program, event)
                case LineRejected():
                    self._line_rejected(program, event)
                case WaitChanged():
                    program.waits_before = event.waits_for
                    found = event.diagnostic
                    if found is not None:
                        message = f"waits: {found.message}"
                        self._table.publish("program.message", program, line=found.line, message=message)
                case ContactAhead():
                    self._fail(program, event.diagnostic)

    def _planner_failed(self, event: PlannerFailed) -> None:
        """Stop the program at which the planner failed, or all."""
        for program in list(self._table.programs.values()):
            if program.over or event.program not in ("", program.program):
                continue
            message = f"the planner failed: {event.message}"
            hint = "this is a defect of the server; its log tells more. Open the program again"
            self._fail(program, Diagnostic("MC516", message, program.progress.started, hint=hint))
        if not event.program:
            # the ended planner puts no more rows, and the next one knows none of its programs
            self._table.start(self._table.leases.forgotten(None))
            self._end_at_rest()

    def _fail(self, program: Program, found: Diagnostic) -> None:
        """Stop a program for a fault found by the planner, which may repeat it until it gets the stop."""
        if program.over or program.state == "ending":
            return
        fault = Fault(
            code=found.code,
            message=found.message,
            hint=found.hint,
            program=program.program,
            line=found.line,
            t=self._table.time.now(),
        )
        if not program.by_hand:
            # not latched; whoever jogs learns of it at the jog's end
            self._table.events.publish(
                "fault", fault=fault, program=fault.program, line=fault.line, message=fault.message
            )
        self._table.stop(program, "faulted", fault.message, fault)

    def _end_at_rest(self) -> None:
        """End programs that are at rest after the planner's process has ended.

        The executor's event of their end may be lost with the planner.
        """
        ending = [program for program in self._table.programs.values() if program.state == "ending"]
        for program in ending:
            if program.slot is not None and self._table.port.ended(program.slot):
                self._table.end(program, program.ended_as)
        if ending:
            self._loop.call_later(AT_REST_S, self._end_at_rest)

    def _consumed(self, program: Program, event: Consumed) -> None:
        if event.through > program.queue.accepted:
            # numbered before a rejection
            return
        program.queue.consume(event.through)
        limit = program.queue.limit
        if program.last_reported_credit < limit // 4 and program.credit > limit // 2:
            self._table.acks.acknowledge(program)

    def _validated(self, program: Program, event: Validated) -> None:
        program.validated = max(program.validated, event.through)
        program.planned_end_u = event.end_u
        program.settle()

    def _line_rejected(self, program: Program, event: LineRejected) -> None:
        if event.epoch != program.epoch:
            return
        diagnostics = [wire_diagnostic(diagnostic) for diagnostic in event.diagnostics]
        program.reject(event.line, diagnostics)
        self._table.journal.rejected(program.program, event.line)
        self._table.publish("line.rejected", program, line=event.line, diagnostics=diagnostics)
        if event.final or program.closed:
            program.closed = True
            program.ended_as = "rejected"
        self._table.acks.acknowledge(program)
