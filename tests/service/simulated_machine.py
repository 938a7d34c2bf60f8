"""What a simulated cell stands on: disk, executor, and planner behind a pipe, with faults from its seed."""

from __future__ import annotations

import sqlite3
from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.rings import ProgramRing
from mcserver.planning.line_buffer import LineBuffer
from mcserver.planning.planner import Planner
from mcserver.planning.planner_messages import (
    OnPlannerEvents,
    PipelineRequest,
    PlannerCommand,
    PlannerEvent,
    PlannerFailed,
    Report,
    ReportKind,
)
from mcserver.planning.start_state import PauseEnd, StartState, StateBefore
from mcserver.service.executor_port import Snapshot
from mcserver.service.journal_file import open_journal
from tests.service.fakes import FakePort, FakeSink, three_axes
from tests.service.simulated_laws import require

if TYPE_CHECKING:
    from tests.service.simulated_cell import Cell


class SimulatedDisk:
    """A journal's connection; while the disk is full nothing can be written, while it stalls nothing ends."""

    def __init__(self, path: Path) -> None:
        self.full = False
        self.stalled = False
        self._connection = open_journal(path)

    def execute(self, statement: str, parameters: tuple[object, ...] = ()) -> Iterable[Any]:
        # what was begun can be taken back on a full disk too
        if self.full and statement != "ROLLBACK":
            raise sqlite3.OperationalError("database or disk is full")
        return self._connection.execute(statement, parameters)

    def close(self) -> None:
        self._connection.close()


class SimulatedPort(FakePort):
    """An executor that takes its time to stop, and checks who owns its axes."""

    def __init__(self, cell: Cell) -> None:
        super().__init__(three_axes())
        self.epoch = 0.0
        self.stopped = False
        self._cell = cell
        self._owners: dict[int, frozenset[int]] = {}
        self._aborted: set[int] = set()

    def happen(self, kind: EventKind, slot: int, line: int = 0, **values: object) -> None:
        if kind in (EventKind.FINISHED, EventKind.STOPPED):
            self._owners.pop(slot, None)
        super().happen(kind, slot, line, time=self._cell.loop.time(), **values)

    def begin(self, slot: int, axes: frozenset[int], *, ratio: float, held: bool, **_more: object) -> None:
        taken = frozenset[int]().union(*self._owners.values())
        require(slot not in self._owners and not taken & axes, f"slot {slot} takes axes that are in motion")
        self._owners[slot] = axes
        self._aborted.discard(slot)
        super().begin(slot, axes, ratio=ratio, held=held)

    def snapshot(self) -> Snapshot:
        return msgspec.structs.replace(super().snapshot(), time=self._cell.loop.time())

    def runs(self, slot: int) -> bool:
        return slot in self._owners and slot not in self._aborted and not self.stopped

    def fail(self, slot: int, line: int) -> None:
        """A drive fails; the other axes pass the lines on their way to a stop."""
        self._aborted.add(slot)
        self.happen(EventKind.FAULT, slot, line, code=FaultCode.FOLLOWING_ERROR, axis=0)
        self.happen(EventKind.LINE_START, slot, line + 2)
        self._cell.later(self._come_to_rest, slot)

    def moving(self) -> list[int]:
        """Slots whose programs run."""
        return [slot for slot in self._owners if self.runs(slot)]

    def abort(self, slot: int) -> None:
        if slot not in self._owners or slot in self._aborted:
            return
        self._aborted.add(slot)
        self._cell.later(self._come_to_rest, slot)

    def _come_to_rest(self, slot: int) -> None:
        if slot in self._owners:
            self.happen(EventKind.STOPPED, slot)

    def emergency_stop(self) -> None:
        self.stopped = True

    def reset(self, axes: frozenset[int]) -> None:  # noqa: ARG002
        self.stopped = False


class SimulatedPipeline:
    """Every line is a move, but each fifth, which takes no time; ``bad`` is faulty the first time.

    Lines are planned ahead of what is executed.
    """

    def __init__(self, cell: Cell, request: PipelineRequest, lines: LineBuffer, sink: FakeSink) -> None:
        self.planned_line = 0
        self.planned_end_u = 0.0
        self._cell = cell
        self._program = request.program
        self._lines = lines
        self._port, self._slot = sink.port, sink.slot
        self._reports: list[Report] = []
        self._ended = False
        self._ahead: deque[tuple[int, str]] = deque()
        # the line under way, the last one that has ended, and up to where that was said
        self._line = self._last = self._marked = 0

    def pump(self, u: float | None = None, override: float = 1.0, rate: float = 1.0) -> bool:  # noqa: ARG002
        if self._ended:
            return False
        draw = self._cell.random
        for _ in range(draw.randint(0, 5)):
            if not self._lines.ready:
                break
            try:
                number, text = self._lines.take()
            except ProgramRejected as rejected:
                self._reject(rejected.diagnostics[0])
                return True
            if text.startswith("bad"):
                self._reject(Diagnostic(code="MC101", message=text, line=number))
                return True
            if number % 5:
                self._reports.append(Report(ReportKind.PLANNED, number, requested_s=0.1))
            self.planned_line = number
            self._ahead.append((number, text))
        if self._port.runs(self._slot):
            for _ in range(draw.randint(0, 8)):
                self._step()
        return True

    def _step(self) -> None:
        """End the line under way, or begin the next one."""
        happen = self._port.happen
        if self._line:
            happen(EventKind.LINE_END, self._slot, self._line)
            self._end(self._line)
        elif self._ahead:
            number, text = self._ahead.popleft()
            self._cell.execute(self._program, number, text)
            if number % 5:
                happen(EventKind.LINE_START, self._slot, number)
                self._line = number
            else:
                self._end(number)
        elif self._lines.closed and not self._lines:
            if not self._ended:
                happen(EventKind.FINISHED, self._slot, self.planned_line)
            self._ended = True
        elif self._last > self._marked:
            self._marked = self._last
            happen(EventKind.PASSED, self._slot, self._last)
        self._cell.under_way[self._slot] = self._line

    def _end(self, number: int) -> None:
        self._line, self._last = 0, number
        self._cell.ended[self._program] = number

    def on_event(self, event: ExecutorEvent) -> None:
        self._ended |= event.kind is EventKind.STOPPED

    def end_pause(self, end: PauseEnd) -> None:
        """No pause is waited for here."""

    def take_reports(self) -> list[Report]:
        reports, self._reports = self._reports, []
        return reports

    def _reject(self, fault: Diagnostic) -> None:
        self._reports.append(Report(ReportKind.REJECTED, fault.line, diagnostics=(fault,)))
        self._lines.clear()


class SimulatedPlanner:
    """A planner behind a pipe that is late and in order, and that can be killed with all that is in it."""

    def __init__(self, cell: Cell, on_events: OnPlannerEvents) -> None:
        self.last_seen = 0.0
        self._cell = cell
        self._on_events = on_events
        self._life = 0
        self._planner = self._fresh()
        self._commands: list[PlannerCommand] = []
        self._events: list[PlannerEvent] = []

    def start(self) -> None:
        self._cell.later(self._turn, self._life)

    def send(self, command: PlannerCommand) -> None:
        self._commands.append(command)

    async def stop(self) -> None:
        self._life += 1

    def kill(self) -> None:
        self._life += 1
        self._commands.clear()
        self._events.clear()
        self._planner = self._fresh()
        self._on_events([PlannerFailed("", "its process was ended by signal 9")])
        self._cell.later(self._turn, self._life)

    def make(
        self,
        request: PipelineRequest,
        lines: LineBuffer,
        sink: ProgramRing,
        slot: int,  # noqa: ARG002
    ) -> SimulatedPipeline:
        assert isinstance(sink, FakeSink)
        return SimulatedPipeline(self._cell, request, lines, sink)

    def _fresh(self) -> Planner:
        return Planner(self._cell.port, self, self._cell.loop.time)

    def _turn(self, life: int) -> None:
        if life != self._life:
            return
        draw = self._cell.random
        for _ in range(draw.randint(0, len(self._commands))):
            self._planner.handle(self._commands.pop(0))
        self._events += self._planner.turn()
        taken = draw.randint(0, len(self._events))
        events, self._events = self._events[:taken], self._events[taken:]
        if events:
            self._on_events(events)
        self._cell.later(self._turn, self._life)


class SimulatedPlanning:
    """Makes the planner of a service."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell

    def state_before(self, lines: object, start: StartState, axes: object) -> StateBefore:
        raise NotImplementedError

    def planner(self, on_events: OnPlannerEvents) -> SimulatedPlanner:
        self._cell.planner = SimulatedPlanner(self._cell, on_events)
        return self._cell.planner
