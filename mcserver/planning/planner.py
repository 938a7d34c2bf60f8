"""The planner: every program's pipeline, and the executor's events, in one thread of control.

It takes commands, lets each pipeline plan a bounded piece in turn, passes the executor's events to their
pipelines, and returns events of its own. Nothing here waits or sleeps: the planner's process
(`mcserver.planning.process`) calls `Planner.turn` repeatedly, tests call it on any clock. The credit that the
service gives to clients bounds all queues.

The executor's events come through here, not straight to the service, because a program must not be reported
as finished before its last lines are reported as validated.
"""

from __future__ import annotations

import enum
import logging
import math
from collections.abc import Callable, Sequence
from typing import Protocol

from mcserver.errors import Diagnostic, McError
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.shm.feedback import SlotView
from mcserver.executor.shm.rings import ProgramRing
from mcserver.planning.line_buffer import LineBuffer
from mcserver.planning.pipeline import Pipeline
from mcserver.planning.planner_messages import (
    Begin,
    CloseProgram,
    Consumed,
    ContactAhead,
    Dropped,
    DropProgram,
    EndPause,
    ExecutorEvents,
    FrameChanged,
    HaltProgram,
    LineRejected,
    Lines,
    PipelineRequest,
    Planned,
    PlannerCommand,
    PlannerEvent,
    PlannerFailed,
    ProgramMessage,
    Report,
    ReportKind,
    StepLine,
    ToolsExchanged,
    Validated,
    WaitChanged,
)

log = logging.getLogger(__name__)

# Period of polling the executor's events while programs run, and while none does [s].
ACTIVE_POLL_S = 0.002
IDLE_POLL_S = 0.02
# Period of estimating the window's end while lines stream in: each estimate plans all of the window [s].
END_PERIOD_S = 0.25
# Pause of the stream after which the end is estimated at once [s].
QUIET_S = 0.02


class PlannerPort(Protocol):
    """The executor as the planner sees it."""

    def poll_events(self) -> list[ExecutorEvent]:
        """Events since the last call, in order."""

    def views(self, slots: Sequence[int]) -> Sequence[SlotView]:
        """Return u and override of each of these slots."""

    def sink(self, slot: int) -> ProgramRing:
        """Return the rings of a program that begins in the slot."""


class PipelineMaker(Protocol):
    """`mcserver.planning.process.PipelineFactory`."""

    def make(self, request: PipelineRequest, lines: LineBuffer, sink: ProgramRing, slot: int) -> Pipeline:
        """Make the pipeline of a program in an executor's slot."""


class PlanPhase(enum.Enum):
    """Phase of a program in the planner."""

    WAITING = "waiting"  # for its lease; lines gather
    PLANNING = "planning"
    HALTED = "halted"  # being stopped: nothing more is planned


class _Plan:
    """One program."""

    def __init__(self, program: str) -> None:
        self.program = program
        self.phase = PlanPhase.WAITING
        self.slot = -1
        self.begun = 0.0
        self.lines = LineBuffer()
        self.pipeline: Pipeline | None = None
        # number of rejections: lines that were sent before the client knew of one are dropped
        self.epoch = 0
        self.consumed = 0
        self.validated = 0
        self.end_u = 0.0
        self.end_asked = -math.inf
        self.end_stale = False
        self.worked = -math.inf

    def halt(self) -> None:
        self.phase = PlanPhase.HALTED
        self.lines.closed = True
        self.lines.clear()


class Planner:
    """Plan the programs of one machine.

    Args:
        port: the executor; its events are the planner's alone.
        pipelines: makes a program's pipeline.
        clock: seconds, never stepping.
    """

    def __init__(self, port: PlannerPort, pipelines: PipelineMaker, clock: Callable[[], float]) -> None:
        self._port = port
        self._pipelines = pipelines
        self._clock = clock
        self._now = clock()
        self._plans: dict[str, _Plan] = {}
        self._events: list[PlannerEvent] = []
        self._busy = False

    @property
    def pause_s(self) -> float:
        """Longest wait for a command before the next `turn` [s]."""
        if self._busy:
            return 0.0
        return ACTIVE_POLL_S if self._plans else IDLE_POLL_S

    def handle(self, command: PlannerCommand) -> None:
        """Take a command; the next `turn` acts on it."""
        match command:
            case Begin():
                self._begin(command)
            case DropProgram():
                self._plans.pop(command.program, None)
                self._events.append(Dropped(command.program))
            case Lines():
                plan = self._plan(command.program)
                if command.epoch == plan.epoch and plan.phase is not PlanPhase.HALTED:
                    plan.lines.put(command.first, command.lines)
            case CloseProgram():
                self._plan(command.program).lines.closed = True
            case HaltProgram():
                if command.program in self._plans:
                    self._plans[command.program].halt()
            case StepLine():
                self._plan(command.program).lines.step()
            case EndPause():
                plan = self._plans.get(command.program, _Plan(command.program))
                if plan.pipeline is not None and plan.phase is PlanPhase.PLANNING:
                    plan.pipeline.end_pause(command.end)

    def turn(self) -> Sequence[PlannerEvent]:
        """Take the executor's events, let every pipeline do a piece of work, and return events in order."""
        self._now = self._clock()
        self._take_events()
        self._busy = False
        running = [plan for plan in self._plans.values() if plan.phase is PlanPhase.PLANNING]
        if running:
            for plan, view in zip(running, self._port.views([plan.slot for plan in running]), strict=True):
                self._busy |= self._advance(plan, view)
        events, self._events = self._events, []
        return events

    def _plan(self, program: str) -> _Plan:
        plan = self._plans.get(program)
        if plan is None:
            plan = self._plans[program] = _Plan(program)
        return plan

    def _begin(self, command: Begin) -> None:
        plan = self._plan(command.program)
        plan.slot = command.slot
        plan.begun = command.begun
        plan.lines.single_line = command.step
        try:
            sink = self._port.sink(command.slot)
            plan.pipeline = self._pipelines.make(command.request, plan.lines, sink, command.slot)
        except Exception as error:
            # a tool's model that does not fit is the machine file's mistake, all else the planner's
            self._fail(plan, str(error) if isinstance(error, McError) else f"{type(error).__name__}: {error}")
        else:
            plan.phase = PlanPhase.PLANNING

    def _take_events(self) -> None:
        events = self._port.poll_events()
        if not events:
            return
        by_slot = {plan.slot: plan for plan in self._plans.values() if plan.pipeline is not None}
        for event in events:
            plan = by_slot.get(event.program)
            if plan is None or plan.pipeline is None or event.time < plan.begun:
                continue
            try:
                plan.pipeline.on_event(event)
                if event.kind in (EventKind.FINISHED, EventKind.STOPPED):
                    # report lines as validated before the end of the program
                    self._validate(plan, plan.pipeline, settled=True)
                    del self._plans[plan.program], by_slot[event.program]
            except Exception as error:
                self._fail(plan, f"{type(error).__name__}: {error}")
        self._events.append(ExecutorEvents(events))

    def _advance(self, plan: _Plan, slot: SlotView) -> bool:
        pipeline = plan.pipeline
        if pipeline is None:
            return False
        try:
            more = pipeline.pump(slot.u, slot.override)
            reports = pipeline.take_reports()
            if plan.lines.consumed > plan.consumed:
                plan.consumed = plan.lines.consumed
                self._events.append(Consumed(plan.program, plan.consumed))
            self._report(plan, reports)
            if more:
                plan.worked = self._now
            self._validate(plan, pipeline, settled=self._now - plan.worked > QUIET_S)
        except Exception as error:
            self._fail(plan, f"{type(error).__name__}: {error}")
            return False
        return more

    def _report(self, plan: _Plan, reports: Sequence[Report]) -> None:
        timed = [report for report in reports if report.kind in (ReportKind.PLANNED, ReportKind.BOUND)]
        if timed:
            self._events.append(Planned(plan.program, timed))
        for report in reports:
            if report.frame is not None:
                self._events.append(FrameChanged(plan.program, report.line, report.frame))
            if report.exchange is not None and not report.exchange.bodies:
                self._events.append(ToolsExchanged(plan.program, report.exchange))
            if report.kind is ReportKind.MESSAGE:
                self._events.append(ProgramMessage(plan.program, report.line, report.message, report.tool))
            if report.kind is ReportKind.CONTACT:
                self._events.append(ContactAhead(plan.program, report.diagnostics[0]))
            if report.kind is ReportKind.WAITING:
                said = next(iter(report.diagnostics), None)
                self._events.append(WaitChanged(plan.program, report.waits_for, said))
            if report.kind is ReportKind.REJECTED:
                self._reject(plan, report.line, report.diagnostics)

    def _reject(self, plan: _Plan, line: int, diagnostics: tuple[Diagnostic, ...]) -> None:
        # the pipeline has closed the buffer where the program ends there
        self._events.append(LineRejected(plan.program, plan.epoch, line, diagnostics, plan.lines.closed))
        plan.consumed = line - 1
        plan.lines.consumed = line - 1
        plan.epoch += 1

    def _validate(self, plan: _Plan, pipeline: Pipeline, *, settled: bool) -> None:
        """Report how far lines are validated; ``settled``: no lines have come for a while."""
        through = pipeline.planned_line
        grown = through > plan.validated
        # estimating the window's end plans all of it
        due = (grown or plan.end_stale) and self._now - plan.end_asked >= END_PERIOD_S
        if due or (settled and (grown or plan.end_stale)):
            plan.end_u, plan.end_asked, plan.end_stale = pipeline.planned_end_u, self._now, False
        elif grown:
            plan.end_stale = True
        else:
            return
        plan.validated = through
        self._events.append(Validated(plan.program, through, plan.end_u))

    def _fail(self, plan: _Plan, message: str) -> None:
        log.exception("the pipeline of %s failed", plan.program)
        plan.halt()
        self._events.append(PlannerFailed(plan.program, message))
