"""An executor and pipelines that need no machine: lines run at once, or wait until a test lets them go."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.shm.feedback import SlotView
from mcserver.executor.shm.mailbox import CommandMailbox
from mcserver.executor.shm.rings import ProgramRing
from mcserver.gcode.semantics.modal import ModalState
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.planning.line_buffer import LineBuffer
from mcserver.planning.planner import Planner
from mcserver.planning.planner_messages import (
    OnPlannerEvents,
    PipelineRequest,
    PlannerCommand,
    Report,
    ReportKind,
)
from mcserver.planning.start_state import PauseEnd, StartState, StateBefore
from mcserver.service.executor_port import Cycles, Snapshot
from mcserver.service.journal import Journal
from mcserver.service.reports import AxisState
from tests.machine_text import axes_text

LIMITED = "min_position = -500.0\nmax_position = 500.0"
THREE_AXES = (
    axes_text(velocity=100.0, acceleration=1000.0, keys=LIMITED)
    + axes_text([1], velocity=100.0, acceleration=1000.0)
    + axes_text([2], rotary=True, velocity=360.0, acceleration=3600.0)
)


@cache
def three_axes() -> Machine:
    """Linear axes 0 and 1, rotary axis 2."""
    return parse_machine(f'[machine]\nname = "bench"\n{THREE_AXES}')


class FakePort:
    """Remembers what it was given, and reports what pipelines and tests make happen."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.epoch = time.time()
        self.orders = self
        self.calls: list[tuple[object, ...]] = []
        self.beats = 0
        self.closed = False
        self.stops_at_once = True
        self.at_rest: set[int] = set()
        self.cycle = 0
        self.states: list[AxisState] = ["standstill"] * len(machine.axes)
        self._events: deque[ExecutorEvent] = deque()
        self._lock = threading.Lock()

    def happen(self, kind: EventKind, slot: int, line: int = 0, **values: object) -> None:
        """Queues an event."""
        stamped = {"time": time.time() - self.epoch, **values}
        if kind in (EventKind.FINISHED, EventKind.STOPPED):
            self.at_rest.add(slot)
        event = ExecutorEvent(kind=kind, program=slot, line=line, **stamped)
        with self._lock:
            self._events.append(event)

    def begin(self, slot: int, axes: frozenset[int], *, ratio: float, held: bool, **_more: object) -> None:
        self.calls.append(("begin", slot, axes, ratio, held))
        self.at_rest.discard(slot)

    def sink(self, slot: int) -> ProgramRing:
        return FakeSink(self, slot)

    def poll_events(self) -> list[ExecutorEvent]:
        with self._lock:
            events = list(self._events)
            self._events.clear()
        return events

    def beat(self) -> None:
        self.beats += 1

    def slots(self) -> list[SlotView]:
        return [SlotView(0.0, 1.0)] * 8

    def views(self, slots: Sequence[int]) -> list[SlotView]:
        return [SlotView(0.0, 1.0) for _ in slots]

    def __getattr__(self, name: str) -> Callable[..., None]:
        """Make an order that is only remembered."""
        if not hasattr(CommandMailbox, name):
            raise AttributeError(name)
        return lambda *values: self.calls.append((name, *values))

    def abort(self, slot: int) -> None:
        self.calls.append(("abort", slot))
        if self.stops_at_once:
            self.happen(EventKind.STOPPED, slot)

    def snapshot(self) -> Snapshot:
        width = len(self.machine.axes)
        return Snapshot(
            time=time.time() - self.epoch,
            setpoint=[0.001] * width,
            position=[0.002] * width,
            velocity=[0.0] * width,
            torque=[0.0] * width,
            states=self.states,
            late_cycles=0,
        )

    def cycles_since(self, cycle: int, limit: int) -> Cycles | None:
        first = self.cycle if cycle < 0 else cycle
        self.cycle = first + limit
        shape = (limit, len(self.machine.axes))
        setpoint = np.arange(first, first + limit)[:, None] * 0.001 * np.ones(shape)
        return Cycles(first, first * 0.001, setpoint, setpoint, np.zeros(shape), np.zeros(shape))

    def ended(self, slot: int) -> bool:
        return slot in self.at_rest

    def ending(self) -> str:
        return ""

    def alive(self) -> bool:
        return not self.closed

    def close(self) -> None:
        self.closed = True


class FakeSink:
    """The slot's rings: never full, nothing is kept."""

    def __init__(self, port: FakePort, slot: int) -> None:
        self.port = port
        self.slot = slot

    def row_room(self) -> int:
        return 1000

    def control_room(self) -> int:
        return 1000

    def put_rows(self, *_rows: object) -> None:
        """Rows go nowhere."""

    def put_control(self, _control: object, _rows: int = 0) -> None:
        """Entries go nowhere."""

    def put_zones_ahead(self, zones: int) -> None:
        """Nothing is told apart."""

    def put_edges(self, *_edges: object) -> None:
        """Beginnings and ends of lines go nowhere."""


class FakePipeline:
    """Lines of text with a meaning of their own.

    ``move`` runs at once, ``wait`` when the gate opens; ``bad`` is faulty and can be corrected; ``fatal`` is
    found faulty while planning and ends the program; ``crash`` is a defect; anything else takes no time.
    """

    def __init__(
        self, request: PipelineRequest, lines: LineBuffer, sink: FakeSink, gate: threading.Event
    ) -> None:
        self.request = request
        self.lines = lines
        self.executed: list[tuple[int, str]] = []
        self.planned_line = 0
        self._port, self._slot = sink.port, sink.slot
        self._gate = gate
        self._held: tuple[int, str] | None = None
        self._reports: list[Report] = []
        self._ended = False

    def pump(self, u: float | None = None, override: float = 1.0, rate: float = 1.0) -> bool:  # noqa: ARG002
        assert u is not None
        if self._ended:
            return False
        worked = False
        while self._held is not None or self.lines.ready:
            try:
                number, text = self._held or self.lines.take()
            except ProgramRejected as rejected:
                self._reject(rejected.diagnostics[0])
                return True
            self._held = None
            if text == "wait" and not self._gate.is_set():
                self._held = number, text
                return worked
            if text == "crash":
                raise RuntimeError("a defect")
            if text in ("bad", "fatal"):
                self.lines.closed |= text == "fatal"
                self._reject(Diagnostic(code="MC101", message=f"{text} line", line=number, column=1))
                return True
            worked = True
            self.executed.append((number, text))
            if text in ("move", "wait"):
                self._reports.append(Report(ReportKind.PLANNED, number, requested_s=0.5))
                self._port.happen(EventKind.LINE_START, self._slot, number)
                self._port.happen(EventKind.LINE_END, self._slot, number)
            self.planned_line = number
        if self.lines.closed and not self.lines:
            self._ended = True
            self._port.happen(EventKind.FINISHED, self._slot, self.planned_line)
        elif worked and self._held is None:
            self._port.happen(EventKind.PASSED, self._slot, self.planned_line)
        return worked

    def _reject(self, fault: Diagnostic) -> None:
        self._reports.append(Report(ReportKind.REJECTED, fault.line, diagnostics=(fault,)))
        self.lines.clear()

    def on_event(self, event: ExecutorEvent) -> None:
        assert event.program == self._slot

    def end_pause(self, end: PauseEnd) -> None:
        """No pause is waited for here."""

    def take_reports(self) -> list[Report]:
        reports, self._reports = self._reports, []
        return reports

    @property
    def planned_end_u(self) -> float:
        return 1000.0


class LoopPlanner:
    """Runs a planner in the loop, in turn with all else that runs there."""

    def __init__(self, planner: Planner, on_events: OnPlannerEvents) -> None:
        self.last_seen = time.monotonic()
        self._planner = planner
        self._on_events = on_events
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        self._turn()

    def send(self, command: PlannerCommand) -> None:
        self._planner.handle(command)

    async def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _turn(self) -> None:
        self.last_seen = time.monotonic()
        events = self._planner.turn()
        if events:
            self._on_events(events)
        self._timer = self._loop.call_later(self._planner.pause_s, self._turn)


class FakePipelines:
    """Plans in this process; keeps the pipelines that it makes for the test to look at."""

    def __init__(self, port: FakePort) -> None:
        self.port = port
        self.made: dict[str, FakePipeline] = {}
        self.gate = threading.Event()
        self.failure: Exception | None = None

    def planner(self, on_events: OnPlannerEvents) -> LoopPlanner:
        return LoopPlanner(Planner(self.port, self, time.monotonic), on_events)

    def state_before(self, lines: Sequence[str], start: StartState, axes: frozenset[int]) -> StateBefore:
        if "bad" in lines:
            raise ProgramRejected([Diagnostic(code="MC101", message="bad line", line=lines.index("bad") + 1)])
        modal = ModalState(inch="G20" in lines, incremental="G91" in lines, frame=start.frame)
        nothing = frozenset[int]()
        return StateBefore(modal, start.positions, nothing, nothing, {}, {}, {}, ended=not axes)

    def make(
        self,
        request: PipelineRequest,
        lines: LineBuffer,
        sink: ProgramRing,
        slot: int,  # noqa: ARG002
    ) -> FakePipeline:
        if self.failure is not None:
            raise self.failure
        assert isinstance(sink, FakeSink)
        pipeline = self.made[request.program] = FakePipeline(request, lines, sink, self.gate)
        return pipeline


def executed_lines(pipelines: FakePipelines, program: str) -> list[int]:
    """Numbers of the lines that a program has executed."""
    return [number for number, _ in pipelines.made[program].executed]


def open_program(
    journal: Journal,
    program: str,
    *,
    instance: str = "now",
    axes: Sequence[int] = (0,),
    start_line: int = 1,
    before: Sequence[str] = (),
) -> None:
    """Record a program of nobody in particular."""
    journal.program_opened(
        program,
        instance=instance,
        client="hmi",
        name="demo",
        axes=axes,
        start_line=start_line,
        on_disconnect="stop",
        resume_of=None,
        at=1.0,
        before=before,
    )
