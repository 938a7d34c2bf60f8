"""One program's way from lines of text to setpoint rows: parse, interpret, plan, hand over.

Plain code without threads or clocks: `pump` does a bounded piece of work and says whether there is more. The
server calls it from its planner thread, `mcserver simulate` between the cycles of its virtual clock.
"""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import numpy as np

from kinematics.pose import Kinematics
from mcserver.config import Machine
from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.executor.entries import Control, ControlKind, EventKind, ExecutorEvent, MotionSink
from mcserver.gcode.interpreter import Interpreter
from mcserver.gcode.modal import INITIAL, ModalState
from mcserver.gcode.parser import ParsedLine, scan_line
from mcserver.motion.canonical import (
    AxisLine,
    AxisOperation,
    Canonical,
    DwellGroup,
    EndLine,
    FeedGroup,
    Group,
    MotionLine,
    PauseLine,
    RapidGroup,
    SpeedGroup,
    TorqueGroup,
    requested_of,
)
from mcserver.motion.lookahead import PlannedRun
from mcserver.motion.node import Bound, PlanningError
from mcserver.motion.pieces import Activation, LineBound, LineMark, Piece
from mcserver.motion.planner import MotionPlanner
from mcserver.motion.sampling import Rows
from mcserver.programs.output import Output

# Lines that may wait for the planner.
QUEUE = 4096
# How far ahead of the executor motion is handed over [cycles]; what is not can still flow into later lines.
AHEAD = 200
# Below this lead motion is handed over although more lines are waiting to be read [cycles].
URGENT = 80
# Below this lead the stop at the window's end is handed over too: no more lines came in time [cycles].
DRY = 40
# Lines taken from the queue in one piece of work.
BITE = 64
# Lines in the window that a program at rest waits for before its first motion, while more are queued.
FIRST_WINDOW = 64


class ReportKind(enum.Enum):
    """What a pipeline reports."""

    PLANNED = "planned"  # the line is being planned: `requested_s`, `feed_length` are known
    BOUND = "bound"  # a limit has stretched the line: `bound_by`
    REJECTED = "rejected"  # a fault in the line; nothing of it moves, nothing after it is read
    FINISHED = "finished"  # all that was submitted has been handed over, the end of the program included


class Report(msgspec.Struct, frozen=True):
    """One report of the planner about a line.

    Attributes:
        requested_s: time that the line asks for [s], or None.
        bound_by: the limit that stretched it, such as ``axis 2 acceleration``, or None.
        feed_length: linear length of its G01-G03 commands [m].
    """

    kind: ReportKind
    line: int
    requested_s: float | None = None
    bound_by: str | None = None
    feed_length: float = 0.0
    diagnostics: tuple[Diagnostic, ...] = ()


_OPERATIONS = list(AxisOperation)


class _InPosition(msgspec.Struct, frozen=True):
    """The exact stop that ends a line whose motion has been planned."""

    line: int
    axes: tuple[int, ...]


def _then(first: Iterator[Piece | Control] | None, after: list[Control]) -> Iterator[Piece | Control]:
    if first is not None:
        yield from first
    yield from after


class Pipeline:
    """Plans one program.

    Args:
        positions: where the axes are at the start, axis number → [m or rad].
        energized: axes that hold a position at the start.
        lease: axes that the program may name; None: all.
        modal: state to start with, for a program that starts in its middle.
    """

    def __init__(
        self,
        machine: Machine,
        sink: MotionSink,
        *,
        positions: Mapping[int, float],
        kinematics: Kinematics | None = None,
        energized: frozenset[int] = frozenset(),
        lease: frozenset[int] | None = None,
        modal: ModalState | None = None,
    ) -> None:
        self._machine = machine
        self._width = len(machine.axes)
        self._slots = {axis.index: column for column, axis in enumerate(machine.axes)}
        self._interpreter = Interpreter(
            machine, kinematics=kinematics, positions=positions, lease=lease, modal=modal or INITIAL
        )
        start = np.array([positions[axis.index] for axis in machine.axes])
        self._planner = MotionPlanner(machine, start)
        self._output = Output(sink)
        self._source: Iterator[Piece | Control] | None = None
        self._queue: deque[tuple[int, str]] = deque()
        self._canonical: deque[Canonical | _InPosition] = deque()
        self._held: ParsedLine | None = None
        self._energized = set(energized)
        self._ideal = frozenset(axis.index for axis in machine.axes if axis.drive.kind == "ideal")
        # axes that G1020 may still be moving
        self._independent: set[int] = set()
        # axes whose capture nobody has asked for the reading of yet; they stand
        self._captured: set[int] = set()
        self._unsettled: frozenset[int] = frozenset()
        self._from_rest = False
        self._tolerance = 0.0
        self._closed = False
        self._failed = False
        self._ended = False
        self._finishing = False
        self._token = 0
        self._waiting_for: int | None = None
        self._reports: deque[Report] = deque()
        self._flush = False
        self._last_line = 0

    # ------------------------------------------------------------------ input

    @property
    def credit(self) -> int:
        """How many more lines may be submitted."""
        return max(0, QUEUE - len(self._queue)) if not self._closed else 0

    def submit(self, number: int, text: str) -> None:
        """Queues a line, unless the queue is full.

        Raises:
            OverflowError: more lines than `credit`; the line was not taken.
        """
        if self.credit < 1:
            raise OverflowError("the planner's queue is full")
        self._queue.append((number, text))

    def close(self) -> None:
        """No more lines will come; what is there runs to its end."""
        self._closed = True

    def abort(self) -> None:
        """Drops all that has not been handed over: the program was stopped."""
        self._closed = True
        self._failed = True
        self._queue.clear()
        self._canonical.clear()
        self._output.drop()
        self._source = None

    @property
    def finished(self) -> bool:
        """Whether everything, the program's end included, has been handed over."""
        return self._finishing and not self._output.blocked and self._source is None

    @property
    def waiting(self) -> bool:
        """Whether planning waits for the executor to tell where axes are."""
        return self._waiting_for is not None

    @property
    def handed_over_u(self) -> float:
        """Up to where rows are in the ring or motion has ended, on the program's time axis [cycles]."""
        return self._output.last_u

    @property
    def failed(self) -> bool:
        """Whether planning ended with a fault."""
        return self._failed

    @property
    def planned_end_u(self) -> float:
        """Where what has been planned so far ends on the program's time axis [cycles]."""
        return self._planner.end_u

    def remaining_s(self, u: float) -> float:
        """Time from ``u`` to the end of what has been planned, at 100 % and without waits [s]."""
        return max(0.0, (self.planned_end_u - u) * self._machine.cycle_s)

    def take_reports(self) -> list[Report]:
        """Reports since the last call."""
        reports = list(self._reports)
        self._reports.clear()
        return reports

    def on_event(self, event: ExecutorEvent) -> None:
        """What the executor says of this program's slot."""
        if event.kind is EventKind.SETTLED and event.token == self._waiting_for:
            self._waiting_for = None
            setpoints = event.values[: self._width]
            observed = {axis.index: setpoints[column] for column, axis in enumerate(self._machine.axes)}
            self._energized |= self._unsettled
            if self._held is not None:
                self._interpreter.observe({axis: observed[axis] for axis in self._unsettled})
                for axis in self._unsettled:
                    self._planner.position[self._slots[axis]] = observed[axis]
        elif event.kind in (EventKind.FAULT, EventKind.STOPPED):
            self.abort()

    # ------------------------------------------------------------------ work

    def pump(self, u: float | None = None) -> bool:
        """Does a bounded piece of work.

        Args:
            u: where the executor is on this program's time axis [cycles]; None where nothing hurries (a
                virtual clock): then nothing is handed over before the window is full or closed.

        Returns:
            True if something was done.
        """
        worked = self._output.flush()
        if self._output.blocked or self._failed:
            return worked
        if self._source is not None:
            return self._draw() or worked
        if self._finishing:
            return worked
        lead = None if u is None else self._planner.u - u
        if self._flush or self._planner.full or (lead is not None and self._hurry(lead)):
            if self._hand_over(u, lead):
                return True
        if self._waiting_for is not None:
            return worked
        try:
            return self._read(u) or worked
        except ProgramRejected as rejected:
            self._reject(rejected)
            return True
        except PlanningError as error:
            self._reject(
                ProgramRejected(
                    [
                        Diagnostic(
                            code="MC290",
                            line=error.line,
                            message="no time law keeps all limits on this line",
                            hint="give the line a lower F, or stop before it with G09 on the line above",
                        )
                    ]
                )
            )
            return True

    def _hurry(self, lead: float) -> bool:
        """Whether motion has to be handed over now."""
        if not self._planner.pending:
            return False
        more = bool(self._queue or self._canonical) and not self._flush
        if more and not self._planner.moving:
            # a start from rest: the first lines decide how soon, those behind them how fast
            return self._planner.pending >= FIRST_WINDOW
        return lead < (URGENT if more else AHEAD)

    def _hand_over(self, u: float | None, lead: float | None) -> bool:
        if self._flush:
            self._flush = False
            self._source = self._planner.close()
            return True
        want = float("inf") if u is None else max(u, self._planner.u) + AHEAD
        self._source = self._planner.commit(want)
        if self._source is None:
            more = bool(self._queue or self._canonical)
            if self._planner.full or (not more and (lead is None or lead < DRY or not self._planner.moving)):
                self._source = self._planner.close()
        return self._source is not None

    def _draw(self) -> bool:
        assert self._source is not None
        for piece in self._source:
            self._put(piece)
            if isinstance(piece, Rows):
                self._output.flush()
                return True
        self._source = None
        self._output.flush()
        return True

    def _put(self, piece: Piece | Control) -> None:
        if isinstance(piece, Rows) or isinstance(piece, Control):
            self._output.put(piece)
        elif isinstance(piece, LineBound):
            bound = f"axis {self._machine.axes[piece.bound.column].index} {piece.bound.kind}"
            self._reports.append(Report(ReportKind.BOUND, piece.line, bound_by=bound))
        elif isinstance(piece, LineMark):
            kind = ControlKind.LINE_END if piece.ends else ControlKind.LINE_START
            self._output.put(Control(kind, piece.u, piece.line))
        else:
            kind = ControlKind.BEGIN if isinstance(piece, Activation) else ControlKind.END
            self._output.put(Control(kind, piece.u, piece.line, axes=piece.mask))

    def _reject(self, rejected: ProgramRejected) -> None:
        """A faulty line: what was planned before it runs to its stop, nothing of it and nothing after it."""
        line = rejected.diagnostics[0].line
        self._reports.append(Report(ReportKind.REJECTED, line, diagnostics=rejected.diagnostics))
        self._queue.clear()
        self._canonical.clear()
        self._held = None
        self._closed = True
        self._ended = True
        self._flush = self._planner.pending > 0

    # ------------------------------------------------------------------ lines

    def _read(self, u: float | None) -> bool:
        worked = False
        for _ in range(BITE):
            if self._canonical:
                if not self._step():
                    return True
                worked = True
            elif self._held is not None or self._queue:
                if not self._interpret():
                    return True
                worked = True
            else:
                break
            if self._planner.full or self._flush or self._source is not None or self._output.blocked:
                return True
        if not self._canonical and not self._queue and self._held is None and self._closed:
            if self._planner.pending:
                self._flush = True
                return True
            self._control(ControlKind.FINISH, self._last_line)
            self._finishing = True
            self._output.flush()
            self._reports.append(Report(ReportKind.FINISHED, self._last_line))
            return True
        return worked

    def _interpret(self) -> bool:
        """Takes one line; False where it has to wait for the executor."""
        if self._held is None:
            number, text = self._queue.popleft()
            self._last_line = number
            self._held = scan_line(text, number)
        parsed = self._held
        unknown = self._interpreter.encoder_axes(parsed)
        if unknown:
            # one capture makes all its axes unknown: asked for together, later lines need not stop for the others
            unknown |= self._captured
            if self._planner.pending:
                self._flush = True
                return False
            self._settle(unknown)
            return False
        self._held = None
        self._canonical.extend(self._interpreter.interpret(parsed))
        if self._interpreter.ended:
            self._ended = True
            self._closed = True
            self._queue.clear()
        return True

    def _settle(self, axes: frozenset[int]) -> None:
        """Asks the executor to bring axes to rest and to tell where they are (D-14, D-25)."""
        self._planner.to_whole_cycle()
        self._control(ControlKind.HALT_AXES, self._last_line, axes=self._mask(tuple(axes)))
        self._independent -= axes
        self._captured -= axes
        self._await_settled(axes)

    def _await_settled(self, axes: frozenset[int]) -> None:
        self._token += 1
        self._unsettled = axes
        self._waiting_for = self._token
        self._control(ControlKind.SETTLE, self._last_line, axes=self._mask(tuple(axes)), token=self._token)
        self._output.flush()

    def _step(self) -> bool:
        """Plans the next canonical line; False where the window has to be handed over first."""
        line = self._canonical[0]
        if isinstance(line, MotionLine) and len(line.groups) == 1:
            group = line.groups[0]
            if isinstance(group, FeedGroup):
                self._canonical.popleft()
                if self._flow(line, group):
                    return True
                self._canonical.appendleft(line)
        if self._planner.pending:
            self._flush = True
            return False
        self._from_rest = False
        self._canonical.popleft()
        if isinstance(line, MotionLine):
            self._stand(line)
        elif isinstance(line, _InPosition):
            self._planner.to_whole_cycle()
            self._output.put(self._wait(line.line, line.axes))
            self._control(ControlKind.LINE_END, line.line)
        elif isinstance(line, AxisLine):
            self._axis_line(line)
        elif isinstance(line, PauseLine):
            self._planner.to_whole_cycle()
            self._control(ControlKind.PAUSE, line.line)
        elif isinstance(line, EndLine):
            self._last_line = line.line
        return True

    def _report(self, line: MotionLine) -> None:
        self._reports.append(
            Report(
                ReportKind.PLANNED, line.line, requested_s=requested_of(line), feed_length=line.feed_length
            )
        )

    def _flow(self, line: MotionLine, group: FeedGroup) -> bool:
        """Takes the line as a segment of the window; False where it does not travel or its axes do not hold."""
        if not self._energized.issuperset(group.axes) or self._independent.intersection(group.axes):
            return False
        segment = self._planner.segment(group, line.line)
        if not segment.travels:
            return False
        self._report(line)
        tolerance = min(self._tolerance, line.tolerance)
        self._planner.append(segment, from_rest=self._from_rest, tolerance=tolerance)
        self._tolerance = line.tolerance
        # with drives that follow in the same cycle an exact stop is a stop, and waits for nothing
        self._from_rest = line.exact_stop
        if line.exact_stop and not self._ideal.issuperset(group.axes):
            segment.closes = False
            self._canonical.appendleft(_InPosition(line.line, group.axes))
            self._flush = True
        return True

    def _stand(self, line: MotionLine) -> None:
        """A line that starts and ends at rest: rapids, dwells, comma groups, transmitted commands."""
        planner = self._planner
        feeds = [group for group in line.groups if isinstance(group, FeedGroup)]
        loose = {axis for group in feeds for axis in group.axes} - self._energized
        if loose:
            self._ask_energized(line, frozenset(loose))
            return
        self._report(line)
        waits = {
            axis
            for group in line.groups
            if isinstance(group, RapidGroup) and group.wait
            for axis in group.axes
        }
        if line.exact_stop:
            waits |= {axis for group in feeds for axis in group.axes} - self._ideal
        if any(isinstance(group, RapidGroup) for group in line.groups) or waits:
            planner.to_whole_cycle()
        start = planner.u
        self._control(ControlKind.LINE_START, line.line)
        for group in line.groups:
            self._transmit(group, line.line)
        end = start
        bound: Bound | None = None
        if feeds:
            pieces, runs, end = planner.together(feeds, line.line)
            bound = self._last_bound(runs)
            if bound is not None:
                self._put(LineBound(line.line, bound))
        # what lasts without moving: a dwell beside other groups, a G93 line without travel (D-30)
        lasting = [group.duration or 0.0 for group in feeds]
        dwells = [group.seconds for group in line.groups if isinstance(group, DwellGroup)]
        alone = dwells and len(line.groups) == 1
        end = max(end, start + max(lasting + ([] if alone else dwells), default=0.0) * self._machine.cycle_hz)
        if feeds and any(run is not None for run in runs):
            self._source = pieces
        planner.u = max(planner.u, end)
        after: list[Control] = []
        if alone:
            after.append(Control(ControlKind.DWELL, planner.u, line.line, seconds=dwells[0]))
        if waits:
            planner.to_whole_cycle()
            end = planner.u
            after.append(self._wait(line.line, tuple(sorted(waits))))
            self._independent -= waits
        after.append(Control(ControlKind.LINE_END, end, line.line))
        self._source = _then(self._source, after)

    def _last_bound(self, runs: list[PlannedRun | None]) -> Bound | None:
        """What stretched the group that ends last."""
        travelling = [run for run in runs if run is not None]
        if not travelling:
            return None
        return max(travelling, key=lambda run: run.phases.duration).bound_by[0]

    def _transmit(self, group: Group, line: int) -> None:
        """Starts what the executor does by itself: independent motion, speed, torque."""
        if isinstance(group, RapidGroup):
            kind, values = ControlKind.RAPID, group.targets
            for axis, target in zip(group.axes, group.targets, strict=True):
                self._planner.position[self._slots[axis]] = target
            self._independent |= set(group.axes)
        elif isinstance(group, SpeedGroup):
            kind, values = ControlKind.SPEED, group.velocities
            self._independent -= set(group.axes)
        elif isinstance(group, TorqueGroup):
            kind, values = ControlKind.TORQUE, group.torques
            self._independent -= set(group.axes)
        else:
            return
        self._energized |= set(group.axes)
        self._captured -= set(group.axes)
        row = [0.0] * self._width
        for axis, value in zip(group.axes, values, strict=True):
            row[self._slots[axis]] = value
        self._control(kind, line, axes=self._mask(group.axes), values=tuple(row))

    def _axis_line(self, line: AxisLine) -> None:
        """G1000-G1011 for axes whose motion has ended (D-40)."""
        self._planner.to_whole_cycle()
        moving = tuple(sorted(self._independent.intersection(line.axes)))
        if moving:
            self._output.put(self._wait(line.line, moving))
            self._independent -= set(moving)
        self._control(
            ControlKind.AXIS,
            line.line,
            axes=self._mask(line.axes),
            operation=_OPERATIONS.index(line.operation),
        )
        if line.operation is AxisOperation.CAPTURE:
            self._captured |= set(line.axes) - self._energized
            self._energized |= set(line.axes)
        else:
            self._captured -= set(line.axes)
            self._energized -= set(line.axes)

    def _ask_energized(self, line: MotionLine, axes: frozenset[int]) -> None:
        """Lets the executor judge axes that no capture of this program holds (D-27): it faults, or they hold."""
        self._control(ControlKind.BEGIN, line.line, axes=self._mask(tuple(axes)))
        self._canonical.appendleft(line)
        self._await_settled(axes)

    def _wait(self, line: int, axes: tuple[int, ...]) -> Control:
        return Control(
            ControlKind.WAIT,
            self._planner.u,
            line,
            axes=self._mask(axes),
            seconds=self._machine.exact_stop_timeout,
        )

    def _mask(self, axes: tuple[int, ...]) -> int:
        mask = 0
        for axis in axes:
            mask |= 1 << self._slots[axis]
        return mask

    def _control(self, kind: ControlKind, line: int, **more: Any) -> None:
        self._output.put(Control(kind, self._planner.u, line, **more))
