"""The programs of one machine and what moves them on: journal, leases, planner, executor events.

Everything here runs in the asyncio loop, but the two methods that take what other threads hand over.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Any

from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.fault_codes import WARNINGS, FaultCode
from mcserver.planning.planner_messages import (
    Begin,
    Broken,
    Consumed,
    Deliver,
    Happened,
    Judged,
    Lines,
    Order,
    Outcome,
    PipelineRequest,
    Planned,
    Planner,
    Rejected,
)
from mcserver.service.acknowledgements import AckSender
from mcserver.service.event_log import EventLog
from mcserver.service.fault_latch import FaultLatch
from mcserver.service.fault_texts import fault_of
from mcserver.service.heartbeat import Heartbeat
from mcserver.service.journal import Journal
from mcserver.service.leases import Grant, LeaseTable
from mcserver.service.motion_port import MotionPort
from mcserver.service.program import Program, Reached, Verdict
from mcserver.service.reports import Ack, Event, Fault, ProgramState, wire_diagnostic
from mcserver.service.reports import EventKind as Kind
from mcserver.service.service_options import ServiceOptions

log = logging.getLogger(__name__)

ENDED_PROGRAMS = 100
TICK_S = 0.02


class ProgramTable:
    """Keeps the programs, and carries out what the service has allowed.

    Attributes:
        programs: open ones and the last `ENDED_PROGRAMS` that have ended, oldest first.
        faults: latched until a reset.
        journal_failure: why the journal cannot be written now; empty: it can.
    """

    def __init__(
        self,
        port: MotionPort,
        planner: Callable[[Deliver], Planner],
        options: ServiceOptions,
        *,
        on_ack: Callable[[Ack], None],
        on_event: Callable[[Event], None],
    ) -> None:
        self.port = port
        self.options = options
        self.programs: dict[str, Program] = {}
        self.leases = LeaseTable()
        self.faults = FaultLatch(self.now, self._record)
        self.journal_failure = ""
        self.events = EventLog(options.instance, self.now, on_event)
        self.acks = AckSender(on_ack)
        self._loop = asyncio.get_running_loop()
        self._moved: set[str] = set()
        self._tick_scheduled = False
        self.journal = Journal(
            options.journal, on_commit=self._from_journal, on_failure=self._from_failed_journal
        )
        self.planner = planner(self._from_planner)
        self.heartbeat = Heartbeat(port.beat, lambda: self.planner.seen)

    def now(self) -> float:
        """Executor time [s]."""
        return self.options.clock() - self.port.epoch

    # ------------------------------------------------------------ life of a program

    def add(self, program: Program, before: Sequence[str]) -> None:
        """Journals a new program and queues it for its axes."""
        self.programs[program.program] = program
        self._forget_ended()
        self.journal.program_opened(
            program.program,
            instance=self.options.instance,
            client=program.client,
            name=program.name,
            axes=program.axes,
            start_line=program.start_line,
            on_disconnect=program.on_disconnect,
            resume_of=program.resume_of,
            at=program.opened_at,
            before=before,
        )
        self.publish("program.opened", program)
        self._start(self.leases.request(program.program, program.axes))

    def lines(self, program: Program, first: int, lines: Sequence[str], *, asked: bool) -> None:
        """Lines that the program's queue has taken: to the journal, and from there to the planner."""
        if program.rejected:
            program.rejected = 0
            program.diagnostics = []
        tag = Lines(program.program, program.epoch, first, lines, asked)
        if asked and self.journal.lines_at_once(program.program, first, lines):
            self.planner.order(tag)
            self._journaled([tag])
        else:
            self.journal.lines(program.program, first, lines, tag)

    def close(self, program: Program) -> None:
        """No more lines; what is there runs to its end."""
        if program.closed or program.ended:
            return
        program.closed = True
        # through the journal, so that it comes to the planner behind the lines accepted
        self.journal.after(Order(program.program, "close"))
        self.publish("program.closed", program)

    def stop(self, program: Program, as_state: ProgramState, reason: str, fault: Fault | None = None) -> None:
        """Stops along the path; the program ends ``as_state`` once it is at rest."""
        if program.ended or program.state == "ending":
            return
        program.ended_as = as_state
        program.reason = reason
        program.fault = fault
        # an executor that has died brings nothing to rest
        if program.slot is None or not self.port.alive():
            self._end(program, as_state)
            return
        program.state = "ending"
        program.dismiss(Verdict.TAKEN)
        self.planner.order(Order(program.program, "halt"))
        self.port.abort(program.slot)
        self.acks.acknowledge(program)

    def enter(self, program: Program, state: ProgramState) -> None:
        """Changes the state of a program that has not ended and is not being stopped."""
        if not program.ended and program.state != "ending":
            program.state = state
            program.settle()
            self.acks.acknowledge(program)

    def _start(self, grants: Sequence[Grant]) -> None:
        for grant in grants:
            program = self.programs[grant.program]
            program.slot = grant.slot
            # here, so that no hold or abort can reach the executor before it
            self.port.begin(grant.slot, grant.axes, ratio=program.override, held=program.held)
            request = PipelineRequest(program.program, grant.axes, program.modal)
            self.planner.order(Begin(request, grant.slot, program.step))
            program.modal = None
            self.enter(program, "held" if program.held else "running")
            self.publish("program.started", program)

    def _end(self, program: Program, state: ProgramState) -> None:
        if program.ended:
            return
        self._flush_lines(program)
        program.state = state
        program.closed = True
        program.ended_at = self.options.clock()
        program.slot = None
        program.dismiss(Verdict.TAKEN)
        self.journal.program_ended(
            program.program,
            state,
            program.done,
            program.fault,
            program.ended_at,
            Order(program.program, "drop"),
        )
        self.publish("program.ended", program, line=program.done, fault=program.fault, reason=program.reason)
        self.acks.acknowledge(program)
        self._start(self.leases.release(program.program))

    def _forget_ended(self) -> None:
        ended = [key for key, program in self.programs.items() if program.ended]
        for key in ended[: max(0, len(ended) - ENDED_PROGRAMS)]:
            del self.programs[key]

    # ------------------------------------------------------------ from the threads

    def _from_journal(self, tags: list[object]) -> None:
        # in the writer thread: the planner gets its lines by the shortest way
        for tag in tags:
            if isinstance(tag, Lines | Order):
                self.planner.order(tag)
        self._call(self._journaled, tags)

    def _from_failed_journal(self, reason: str) -> None:
        self._call(self._journal_failed, reason)

    def _from_planner(self, outcomes: list[Outcome]) -> None:
        self._call(self._take_outcomes, outcomes)

    def _call(self, function: Callable[..., None], value: object) -> None:
        try:
            self._loop.call_soon_threadsafe(function, value)
        except RuntimeError:
            log.debug("the loop is closed")

    def _journaled(self, tags: list[object]) -> None:
        if self.journal_failure:
            self.journal_failure = ""
            self.events.publish("warning", reason="MC519", message="the journal can be written again")
        for tag in tags:
            program = self.programs.get(tag.program) if isinstance(tag, Lines | Reached) else None
            if program is None:
                continue
            if isinstance(tag, Reached):
                program.recorded = max(program.recorded, tag.done)
                self.acks.acknowledge(program)
            elif isinstance(tag, Lines) and tag.epoch == program.epoch:
                program.journaled = tag.first + len(tag.lines) - 1
                program.settle()
                if tag.asked:
                    self._has_moved(program)
                else:
                    self.acks.acknowledge(program)

    def _journal_failed(self, reason: str) -> None:
        if self.journal_failure != reason:
            self.journal_failure = reason
            self.events.publish("warning", reason="MC519", message=f"the journal cannot be written: {reason}")

    def _take_outcomes(self, outcomes: list[Outcome]) -> None:
        for outcome in outcomes:
            if isinstance(outcome, Happened):
                for event in outcome.events:
                    self._executor_event(event)
                continue
            if isinstance(outcome, Broken):
                self._broken(outcome)
                continue
            program = self.programs.get(outcome.program)
            if program is None or program.ended:
                continue
            if isinstance(outcome, Consumed):
                self._consumed(program, outcome)
            elif isinstance(outcome, Planned):
                program.progress.planned(outcome.reports)
            elif isinstance(outcome, Judged):
                self._judged(program, outcome)
            elif isinstance(outcome, Rejected):
                self._rejected(program, outcome)

    def _broken(self, outcome: Broken) -> None:
        """Stops the program that the planner failed with, or all of them."""
        for program in list(self.programs.values()):
            if program.ended or outcome.program not in ("", program.program):
                continue
            fault = Fault(
                code="MC516",
                message=f"the planner failed: {outcome.message}",
                hint="this is a defect of the server; its log tells more. Open the program again",
                program=program.program,
                line=program.progress.started,
                t=self.now(),
            )
            self.stop(program, "faulted", fault.message, fault)

    def _consumed(self, program: Program, outcome: Consumed) -> None:
        if outcome.through > program.queue.accepted:
            # of lines before a rejection
            return
        program.queue.consume(outcome.through)
        limit = program.queue.limit
        if program.told_credit < limit // 4 and program.credit > limit // 2:
            self.acks.acknowledge(program)

    def _judged(self, program: Program, outcome: Judged) -> None:
        program.judged = max(program.judged, outcome.through)
        program.planned_end_u = outcome.end_u
        program.progress.planned_through(outcome.through)
        program.settle()
        self._has_moved(program)

    def _rejected(self, program: Program, outcome: Rejected) -> None:
        if outcome.epoch != program.epoch:
            return
        diagnostics = [wire_diagnostic(diagnostic) for diagnostic in outcome.diagnostics]
        program.reject(outcome.line, diagnostics)
        self.journal.rejected(program.program, outcome.line)
        self.publish("line.rejected", program, line=outcome.line, diagnostics=diagnostics)
        if outcome.final or program.closed:
            program.closed = True
            program.ended_as = "rejected"
        self.acks.acknowledge(program)

    # ------------------------------------------------------------ from the executor

    def _executor_event(self, event: ExecutorEvent) -> None:
        program = self._in_slot(event.program)
        if event.kind is EventKind.FAULT:
            self._fault(event, program)
            return
        if program is None:
            return
        if event.kind is EventKind.LINE_START:
            program.progress.line_started(event.line, event.time)
            self._has_moved(program)
        elif event.kind is EventKind.LINE_END:
            program.progress.line_ended(event.line, event.time)
            self._has_moved(program)
        elif event.kind is EventKind.AXIS_DONE:
            program.progress.ended(event.line)
            self._has_moved(program)
        elif event.kind is EventKind.PAUSED:
            self.enter(program, "paused")
            self.publish("program.paused", program, line=event.line)
        elif event.kind is EventKind.FINISHED:
            program.progress.finished(program.judged)
            self._end(program, program.ended_as)
        elif event.kind is EventKind.STOPPED:
            self._end(program, "aborted" if program.ended_as == "finished" else program.ended_as)

    def _fault(self, event: ExecutorEvent, program: Program | None) -> None:
        fault = fault_of(event, None if program is None else program.program)
        if event.code in WARNINGS:
            told = f"{fault.message}: {fault.hint}"
            where = {"program": fault.program, "line": fault.line, "axis": fault.axis}
            self.events.publish("warning", reason=fault.code, message=told, **where)
            return
        if event.code == FaultCode.EMERGENCY_STOP:
            # latched and told by whoever asked for it
            return
        self.faults.latch(fault)
        self.events.publish(
            "fault", fault=fault, program=fault.program, line=fault.line, message=fault.message
        )
        hit = [] if program is None else [program]
        if program is None and fault.axis is None:
            # a fault of the whole machine ends every program, one of an idle axis none
            hit = [each for each in self.programs.values() if not each.ended]
        for each in hit:
            self.stop(each, "faulted", fault.message, fault)

    def _record(self, fault: Fault) -> None:
        self.journal.fault(fault, self.options.clock())

    def _in_slot(self, slot: int) -> Program | None:
        for program in self.programs.values():
            if program.slot == slot and not program.ended:
                return program
        return None

    # ------------------------------------------------------------ out

    def publish(self, kind: Kind, program: Program, **values: Any) -> None:
        """An event about a program."""
        self.events.publish(
            kind, program=program.program, client=program.client, state=program.state, **values
        )

    def _has_moved(self, program: Program) -> None:
        self._moved.add(program.program)
        if not self._tick_scheduled:
            self._tick_scheduled = True
            self._loop.call_later(TICK_S, self._tick)

    def _tick(self) -> None:
        self._tick_scheduled = False
        moved, self._moved = self._moved, set()
        for key in moved:
            program = self.programs.get(key)
            if program is not None and not program.ended:
                self._flush_lines(program)

    def _flush_lines(self, program: Program) -> None:
        """Tells, at most once a tick, which lines have begun and ended."""
        progress = program.progress
        ended = progress.take_ended()
        begun = progress.started > program.told_started
        done = program.done > program.told_done or program.journaled > program.told_accepted
        if not (ended or begun or done):
            return
        if begun:
            self.publish("lines.started", program, line=progress.started)
        if ended:
            self.publish("lines.ended", program, lines=ended)
        program.told_started, program.told_done = progress.started, program.done
        program.told_accepted = program.journaled
        self.journal.progress(program.program, progress.started, program.done, ended)
        self.journal.after(Reached(program.program, program.done))
