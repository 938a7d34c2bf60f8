"""The one thread that owns every program's pipeline, and the executor's event queue.

It takes orders from a queue, gives lines to pipelines as these have room, lets each plan a bounded piece in
turn, hands the executor's events to the pipeline they concern, and reports what happened. What waits here is
bounded by the credit that the service gives to clients.
"""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import Protocol

from mcserver.errors import Diagnostic, McError, ProgramRejected
from mcserver.executor.entries import EventKind, ExecutorEvent, MotionSink
from mcserver.planning.pipeline_reports import Report, ReportKind
from mcserver.planning.planner_messages import (
    MAX_LINE_LENGTH,
    Begin,
    Broken,
    Consumed,
    Deliver,
    Happened,
    Judged,
    Lines,
    Order,
    Orders,
    Outcome,
    PipelineRequest,
    Planned,
    Rejected,
)
from mcserver.service.motion_port import PlannerPort

log = logging.getLogger(__name__)

ACTIVE_POLL_S = 0.002
IDLE_POLL_S = 0.02
LINES_A_TURN = 256
# How often it is asked where a window ends into which lines pour, and after what pause in any case [s].
END_PERIOD_S = 0.25
QUIET_S = 0.02


class LinePipeline(Protocol):
    """Lines in, setpoints out: `mcserver.planning.pipeline.Pipeline`.

    ``planned_line``: every line through it has been read without fault, and planned if it needs time.
    ``credit`` is 0 for good once it takes no more lines.
    """

    @property
    def credit(self) -> int: ...
    @property
    def planned_line(self) -> int: ...
    def submit(self, number: int, text: str) -> None: ...
    def close(self) -> None: ...
    def pump(self, u: float | None = None) -> bool: ...
    def on_event(self, event: ExecutorEvent) -> None: ...
    def take_reports(self) -> Sequence[Report]: ...
    @property
    def planned_end_u(self) -> float: ...


class MakesPipelines(Protocol):
    """`mcserver.planning.pipeline_factory.PipelineFactory`."""

    def make(self, request: PipelineRequest, sink: MotionSink) -> LinePipeline:
        """A program's pipeline, in the planner thread."""


class _Plan:
    def __init__(self, program: str, slot: int, pipeline: LinePipeline, step: bool) -> None:
        self.program = program
        self.slot = slot
        self.pipeline = pipeline
        self.pending: deque[tuple[int, Sequence[str], int]] = deque()
        self.epoch = 0
        self.allowance: int | None = 0 if step else None
        self.closing = False
        self.closed = False
        self.ended = False
        self.judged = 0
        self.end_u = 0.0
        self.end_asked = -math.inf
        self.end_stale = False
        self.worked = -math.inf


class PlannerThread:
    """Runs until `stop`.

    Attributes:
        seen: when it was last at work [s of `time.monotonic`].

    Args:
        port: the executor; its events are this thread's.
        pipelines: makes a program's pipeline; called in this thread.
        deliver: takes what happened, in order; called in this thread.
        pulse_s: it is called at least this often, with nothing if nothing has happened [s].
    """

    def __init__(
        self,
        port: PlannerPort,
        pipelines: MakesPipelines,
        deliver: Deliver,
        *,
        pulse_s: float = math.inf,
    ) -> None:
        self._port = port
        self._pipelines = pipelines
        self._deliver = deliver
        self._inbox: queue.SimpleQueue[Orders | None] = queue.SimpleQueue()
        self._plans: dict[str, _Plan] = {}
        # lines that came before their program had its lease
        self._early: dict[str, list[Lines | Order]] = {}
        self._outcomes: list[Outcome] = []
        self.seen = time.monotonic()
        self._pulse_s = pulse_s
        self._told = self.seen
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="planner", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def order(self, order: Orders) -> None:
        """From any thread."""
        self._inbox.put(order)

    def stop(self, timeout_s: float = 2.0) -> None:
        self._stopping.set()
        self._inbox.put(None)
        self._thread.join(timeout_s)

    def _run(self) -> None:
        busy = False
        while not self._stopping.is_set():
            if busy:
                wait_s = 0.0
            elif self._plans:
                wait_s = ACTIVE_POLL_S
            else:
                wait_s = IDLE_POLL_S
            self._take_orders(wait_s)
            self.seen = time.monotonic()
            self._take_events()
            busy = False
            if self._plans:
                slots = self._port.slots()
                for plan in list(self._plans.values()):
                    busy = self._advance(plan, slots[plan.slot].u) or busy
            if self._outcomes or self.seen - self._told >= self._pulse_s:
                outcomes, self._outcomes = self._outcomes, []
                self._told = self.seen
                self._deliver(outcomes)

    def _take_orders(self, wait_s: float) -> None:
        try:
            order = self._inbox.get(timeout=wait_s) if wait_s else self._inbox.get_nowait()
            while True:
                if order is not None:
                    self._obey(order)
                order = self._inbox.get_nowait()
        except queue.Empty:
            return

    def _obey(self, order: Orders) -> None:
        if isinstance(order, Begin):
            self._begin(order)
            return
        plan = self._plans.get(order.program)
        if isinstance(order, Order) and order.what == "drop":
            self._plans.pop(order.program, None)
            self._early.pop(order.program, None)
        elif plan is None:
            self._early.setdefault(order.program, []).append(order)
        elif isinstance(order, Lines):
            if order.epoch == plan.epoch and not plan.ended:
                plan.pending.append((order.first, order.lines, 0))
        elif order.what == "close":
            plan.closing = True
        elif order.what == "halt":
            plan.ended = True
            plan.pending.clear()
        elif order.what == "step" and plan.allowance is not None:
            plan.allowance += 1

    def _begin(self, order: Begin) -> None:
        name = order.request.program
        try:
            pipeline = self._pipelines.make(order.request, self._port.sink(order.slot))
        except McError as error:
            self._outcomes.append(Broken(name, str(error)))
            return
        except Exception as error:
            log.exception("program %s could not begin", name)
            self._outcomes.append(Broken(name, f"{type(error).__name__}: {error}"))
            return
        plan = _Plan(name, order.slot, pipeline, order.step)
        self._plans[name] = plan
        for early in self._early.pop(name, ()):
            self._obey(early)

    def _take_events(self) -> None:
        events = self._port.poll_events()
        if not events:
            return
        by_slot = {plan.slot: plan for plan in self._plans.values()}
        for event in events:
            plan = by_slot.get(event.program)
            if plan is None:
                continue
            try:
                plan.pipeline.on_event(event)
            except Exception as error:
                self._break(plan, error)
            if event.kind in (EventKind.FINISHED, EventKind.STOPPED):
                self._judge(plan, settled=True)
                self._plans.pop(plan.program, None)
                by_slot.pop(event.program, None)
        self._outcomes.append(Happened(events))

    def _advance(self, plan: _Plan, u: float) -> bool:
        if plan.ended:
            return False
        try:
            fed = self._feed(plan)
            if plan.closing and not plan.closed and not plan.pending:
                plan.closed = True
                plan.pipeline.close()
            more = plan.pipeline.pump(u)
            reports = plan.pipeline.take_reports()
        except Exception as error:
            self._break(plan, error)
            return False
        if reports:
            self._report(plan, reports)
        if more or fed:
            plan.worked = self.seen
        self._judge(plan, settled=self.seen - plan.worked > QUIET_S)
        return more or fed

    def _feed(self, plan: _Plan) -> bool:
        """Gives lines to the pipeline as far as it has room; True if there was any."""
        room = min(plan.pipeline.credit, LINES_A_TURN)
        if plan.allowance is not None:
            room = min(room, plan.allowance)
        through = 0
        while room > 0 and plan.pending:
            first, lines, done = plan.pending.popleft()
            for index in range(done, min(len(lines), done + room)):
                try:
                    _check_text(first + index, lines[index])
                    plan.pipeline.submit(first + index, lines[index])
                except ProgramRejected as rejected:
                    if through:
                        self._outcomes.append(Consumed(plan.program, through))
                    self._reject(plan, first + index, rejected.diagnostics, final=False)
                    return True
                through = first + index
                room -= 1
                if plan.allowance is not None:
                    plan.allowance -= 1
            if through < first + len(lines) - 1:
                plan.pending.appendleft((first, lines, through - first + 1))
        if through:
            self._outcomes.append(Consumed(plan.program, through))
        return through > 0

    def _report(self, plan: _Plan, reports: Sequence[Report]) -> None:
        timed = [report for report in reports if report.kind in (ReportKind.PLANNED, ReportKind.BOUND)]
        if timed:
            self._outcomes.append(Planned(plan.program, timed))
        for report in reports:
            if report.kind is ReportKind.REJECTED:
                # a pipeline that still has room goes on with that line, mended; else the program ends there
                final = plan.pipeline.credit == 0
                self._reject(plan, report.line, tuple(report.diagnostics), final=final)

    def _reject(self, plan: _Plan, line: int, diagnostics: tuple[Diagnostic, ...], *, final: bool) -> None:
        self._outcomes.append(Rejected(plan.program, plan.epoch, line, diagnostics, final))
        plan.pending.clear()
        plan.epoch += 1
        if final:
            plan.closing = True

    def _judge(self, plan: _Plan, *, settled: bool) -> None:
        """Tells how far lines are right and planned; ``settled``: nothing has come for a while."""
        through = plan.pipeline.planned_line
        judged = through > plan.judged
        # where the window ends takes a plan of all of it: while lines pour in it is asked for now and then
        due = judged and self.seen - plan.end_asked >= END_PERIOD_S
        if due or (settled and (judged or plan.end_stale)):
            plan.end_u, plan.end_asked, plan.end_stale = plan.pipeline.planned_end_u, self.seen, False
        elif judged:
            plan.end_stale = True
        else:
            return
        plan.judged = through
        self._outcomes.append(Judged(plan.program, through, plan.end_u))

    def _break(self, plan: _Plan, error: Exception) -> None:
        log.error("the pipeline of %s failed", plan.program, exc_info=error)
        plan.ended = True
        plan.pending.clear()
        self._outcomes.append(Broken(plan.program, f"{type(error).__name__}: {error}"))


def _check_text(line: int, text: str) -> None:
    if len(text) > MAX_LINE_LENGTH:
        message = f"the line has {len(text)} characters, more than {MAX_LINE_LENGTH}"
    elif "\n" in text or "\r" in text:
        message = "the line holds a line end"
    else:
        return
    raise ProgramRejected(
        [Diagnostic(code="MC513", message=message, line=line, hint="send one line an item")]
    )
