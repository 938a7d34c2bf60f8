"""Clients, network, service, journal, planner and executor on one virtual clock, with faults from one seed.

Nothing here waits: time goes on to the next thing that is due. Messages are lost, doubled, late and out of
order; the disk is full or stalls for a while; drives fail; the planner and the server are killed at any
moment. After each step that can be seen from outside, what has to hold is checked. The same seed is the same
run.
"""

from __future__ import annotations

import asyncio
import random
import selectors
import sqlite3
from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import msgspec

from mcserver.errors import Diagnostic, ProgramRejected, ServiceError
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
from mcserver.service.reports import Ack, Event
from mcserver.service.service import MachineService
from mcserver.service.service_options import ServiceOptions
from tests.service.fakes import FakePort, FakeSink, three_axes
from tests.service.simulated_client import SimulatedClient
from tests.service.simulated_laws import Said, Violation, require

LIMIT_S = 60.0


class _NothingToRead(selectors.SelectSelector):
    """Asks the system for nothing: all that happens here is in timers and callbacks."""

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:  # noqa: ARG002
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop whose time goes on to the next timer when nothing else is to be done."""

    def __init__(self) -> None:
        self._virtual = 0.0
        super().__init__(_NothingToRead())

    def time(self) -> float:
        return self._virtual

    def _run_once(self) -> None:
        # asyncio's own names: the one place where the next timer can be seen
        timers = self._scheduled  # type: ignore[attr-defined]
        if not self._ready and timers:  # type: ignore[attr-defined]
            self._virtual = max(self._virtual, timers[0]._when)
        super()._run_once()  # type: ignore[misc]


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


class Cell:
    """One run.

    Args:
        seed: of all that happens. journal: its file.
    """

    def __init__(self, seed: int, journal: Path, loop: VirtualLoop) -> None:
        self.random = random.Random(seed)
        self.loop = loop
        self.tasks: set[asyncio.Task[None]] = set()
        self.executed: dict[str, list[int]] = {}
        # the last line of each that has ended, and the line under way in a slot
        self.ended: defaultdict[str, int] = defaultdict(int)
        self.under_way: defaultdict[int, int] = defaultdict(int)
        self.said = Said(lambda program: self.ended[program], self._journaled_end)
        # the same by text
        self.texts: defaultdict[str, dict[int, str]] = defaultdict(dict)
        self.calm = False
        # in callbacks of the loop, and within the planner, which takes them for defects of its own
        self._violations: list[Violation] = []
        # lines of the programs that a kill of the server has ended
        self._kept: dict[str, int] = {}
        loop.set_exception_handler(self._on_exception)
        self._journal = journal
        # reads what is committed; opened by the first question after a start of the server
        self._reader: sqlite3.Connection | None = None
        self._starts = 0
        self.port: SimulatedPort
        self.planner: SimulatedPlanner
        self.service: MachineService
        self._disk: SimulatedDisk
        self._start()
        self._clients = [
            SimulatedClient(self, f"c{n}", self.random.randint(1, 40), axes)
            for n, axes in enumerate([[0], [1], [0, 1], [2]])
        ]

    # ------------------------------------------------------------ what happens

    def later(self, function: Callable[..., None], *arguments: object) -> None:
        self.loop.call_later(self.random.expovariate(50.0), function, *arguments)

    def network(self, deliver: Callable[[], None]) -> None:
        """Delivers a message late, twice or not at all."""
        copies = 1 if self.calm else self.random.choice([0, 1, 1, 1, 1, 2])
        for _ in range(copies):
            self.loop.call_later(self.random.expovariate(20.0), deliver)

    def execute(self, program: str, number: int, text: str) -> None:
        """A line begins to move."""
        try:
            self._execute(program, number, text)
        except Violation as violation:
            self._violations.append(violation)
            raise

    def _on_exception(self, _loop: asyncio.AbstractEventLoop, context: dict[str, object]) -> None:
        error = context.get("exception")
        violation = error if isinstance(error, Violation) else Violation(f"{context['message']}: {error!r}")
        self._violations.append(violation)

    def _execute(self, program: str, number: int, text: str) -> None:
        ran = self.executed.setdefault(program, [])
        require(not self.port.stopped, f"{program} runs line {number} in an emergency stop")
        require(number == (ran[-1] if ran else 0) + 1, f"{program} runs line {number} after {ran[-1:]}")
        require(text.startswith(f"move {program}:{number} "), f"{program} runs {text!r} as line {number}")
        require(self._journaled(program) >= number, f"{program} runs line {number}, which is not journaled")
        ran.append(number)
        self.texts[program][number] = text
        for client in self._clients:
            accepted = client.accepted_text(program, number)
            require(
                accepted in (None, text), f"{program} runs {text!r}, not {accepted!r}, which was accepted"
            )

    def agree(self, program: str, accepted: dict[int, str]) -> None:
        """What ran is what a client takes for accepted."""
        for number, text in accepted.items():
            ran = self.texts[program].get(number)
            require(ran == text, f"{program} ran {ran!r}, and {text!r} was said to be accepted")

    async def run(self, faults: int) -> None:
        """Lets faults happen, then a calm in which every program has to come to its end."""
        for client in self._clients:
            client.work()
        self._write()
        try:
            await self._pass(faults)
        finally:
            if self._violations:
                raise self._violations[0]

    async def _pass(self, faults: int) -> None:
        kinds = [
            self.planner_killed,
            self.server_killed,
            self.disk_full,
            self.disk_stalled,
            self.drive_failed,
            self.stopped,
            self.aborted,
        ]
        for _ in range(faults):
            await asyncio.sleep(self.random.expovariate(3.0))
            if self._violations:
                return
            self.random.choice(kinds)()
        self.calm, self._disk.full, self._disk.stalled = True, False, False
        self._reset()
        until = self.loop.time() + LIMIT_S
        while not (self._violations or all(client.done for client in self._clients)):
            require(self.loop.time() < until, f"programs do not end: {self._states()}")
            await asyncio.sleep(0.1)
        for program, kept in self._kept.items():
            found = self._journaled(program)
            require(found == kept, f"{program} was killed with {kept} lines journaled, {found} came back")

    def planner_killed(self) -> None:
        self.planner.kill()

    def server_killed(self) -> None:
        self.close()
        for program, ran in self.executed.items():
            self._kept[program] = self._journaled(program)
            require(self._kept[program] >= len(ran), f"{program} ran lines that the journal has lost")
            done = self._journaled_end(program)[0]
            require(done <= self.ended[program], f"the journal has {program} done through {done}, {ran} ran")
        self.said.judge_after_a_kill()
        self._start()
        for client in self._clients:
            client.forget()

    def disk_full(self) -> None:
        self._disk.full = not self._disk.full

    def disk_stalled(self) -> None:
        disk = self._disk
        disk.stalled = True
        self.loop.call_later(self.random.expovariate(0.5), setattr, disk, "stalled", False)

    def drive_failed(self) -> None:
        moving = self.port.moving()
        if moving:
            slot = self.random.choice(moving)
            self.port.fail(slot, self.under_way[slot])
            self.later(self._reset)

    def stopped(self) -> None:
        self.service.latch.emergency_stop("", "seed")
        require(self.service.latch.state == "estop", "an emergency stop does not show")
        self.later(self._reset)

    def aborted(self) -> None:
        self.service.abort(None, "seed")

    # ------------------------------------------------------------ inside

    def _start(self) -> None:
        self._starts += 1
        start = self._starts
        self.port = SimulatedPort(self)
        self.service = MachineService(
            self.port.machine,
            self.port,
            SimulatedPlanning(self),
            ServiceOptions(
                journal=self._journal,
                instance=f"i{start}",
                clock=self.loop.time,
                monotonic=self.loop.time,
                connect=self._connect,
                journal_thread=False,
            ),
            on_ack=lambda ack: self._on_ack(start, ack),
            on_event=lambda event: self._on_event(start, event),
        )
        self._seq = 0
        self.service.start()

    def _connect(self, path: Path) -> SimulatedDisk:
        self._disk = SimulatedDisk(path)
        return self._disk

    def close(self) -> None:
        """Ends the server at once: what was not committed is lost, nobody hears what was under way."""
        self._starts += 1
        self._forget_reader()
        self.planner._life += 1
        self.service._table.close_journal()

    def _write(self) -> None:
        if not self._disk.stalled:
            self.service._table.journal.write_pending()
        for program in self.service.current():
            status = program.status()
            self.said.hear("status", status.program, status.done, status.state)
        self.later(self._write)

    def _reset(self) -> None:
        try:
            self.service.reset(None)
        except ServiceError:
            self.later(self._reset)

    def _on_ack(self, start: int, ack: Ack) -> None:
        if start != self._starts:
            return
        require(ack.accepted <= self._journaled(ack.program), f"{ack} before its lines are journaled")
        self.said.hear("ack", ack.program, ack.done, ack.state)
        for client in self._clients:
            self.network(lambda client=client: client.on_ack(ack))  # type: ignore[misc]

    def _on_event(self, start: int, event: Event) -> None:
        repeated = event.kind == "estop" and event.seq <= self._seq
        if start == self._starts and not repeated:
            self._seq += 1
            require(event.seq == self._seq, f"event {event.seq} after {self._seq - 1}")
            if event.kind == "lines.ended" and event.program:
                last = event.lines[-1].line
                # it is done once what comes next has begun
                self.said.hear("lines.ended", event.program, last - 1, None)
                require(last <= self.ended[event.program], f"{event.program} has not ended {last}")
            if event.kind == "program.ended" and event.program:
                self.said.hear("program.ended", event.program, event.line, event.state)

    def _journaled(self, program: str) -> int:
        return self._ask("SELECT coalesce(max(last), 0) FROM chunks WHERE program=?", program)

    def _journaled_end(self, program: str) -> tuple[int, str | None]:
        """How far the journal has a program, and its state there."""
        rows = self._rows("SELECT done, state FROM programs WHERE program=?", program)
        return (int(rows[0][0]), rows[0][1]) if rows else (0, None)

    def _ask(self, sql: str, *parameters: str) -> int:
        return int(self._rows(sql, *parameters)[0][0])

    def _rows(self, sql: str, *parameters: str) -> list[tuple[Any, ...]]:
        if self._reader is None:
            self._reader = sqlite3.connect(self._journal, isolation_level=None)
        return self._reader.execute(sql, parameters).fetchall()

    def _forget_reader(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _states(self) -> list[str]:
        programs = [program.status() for program in self.service.current()]
        return [
            f"{each.program} of {each.client}: {each.state}, {each.accepted}/{each.done}" for each in programs
        ]
