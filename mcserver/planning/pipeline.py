"""One program's way from lines of text to setpoint rows: parse, interpret, plan, hand over.

Plain code without threads or clocks: `pump` does a bounded piece of work and says whether there is more. The
server calls it from its planner thread, `mcserver simulate` between the cycles of its virtual clock.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from itertools import islice

from mckinematics.pose import Kinematics

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.executor.entries import ControlKind, EventKind, ExecutorEvent, MotionSink
from mcserver.executor.fault_codes import WARNINGS
from mcserver.executor.headroom import stopping_rows
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.semantics.modal import INITIAL, ModalState
from mcserver.gcode.text.parser import ParsedLine, scan_line
from mcserver.machine.machine_file import Machine
from mcserver.motion.bound import PlanningError
from mcserver.motion.profile.setpoint_sampling import Rows
from mcserver.planning.line_planner import LinePlanner
from mcserver.planning.pipeline_reports import Report, ReportKind
from mcserver.planning.solving_time import TimedKinematics

__all__ = ["Pipeline", "Report", "ReportKind"]

# Lines that may wait for the planner.
QUEUE = 4096
# How far ahead of the executor motion is handed over [cycles]; what is not can still flow into later lines.
AHEAD = 200
# The longest stop that is provided for: the ring of rows has to hold it [cycles].
LONGEST_STOP = 2500
# Below this lead motion is handed over although more lines are waiting to be read [cycles].
URGENT = 80
# Below this lead the stop at the window's end is handed over too: no more lines came in time [cycles].
DRY = 40
# Lines taken from the queue in one piece of work.
BITE = 64
# Lines that are read in columns at once: a piece of work of some milliseconds.
RUN = 256
# Lines in the window that a program at rest waits for before its first motion, while more are queued.
FIRST_WINDOW = 64


class Pipeline(LinePlanner):
    """Plans one program.

    Args:
        positions: where the axes are at the start, axis number → [m or rad].
        energized: axes that hold a position at the start.
        lease: axes that the program may name; None: all.
        modal: state to start with, for a program that starts in its middle.
        clock: what the time of inverse kinematics is measured with [s].
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
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        super().__init__(machine, sink, positions, energized)
        self._solving = None if kinematics is None else TimedKinematics(kinematics, clock)
        self._interpreter = Interpreter(
            machine, kinematics=self._solving, positions=positions, lease=lease, modal=modal or INITIAL
        )
        # the executor begins to stop when fewer rows are left than a stop takes
        self._stop = min(stopping_rows(machine), LONGEST_STOP)
        self._queue: deque[tuple[int, str]] = deque()
        self._held: ParsedLine | None = None
        self._closed = False
        self._failed = False
        self._ended = False
        self._finishing = False

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
    def playable_u(self) -> float:
        """Up to where the executor may play before the next `pump` without beginning to stop [cycles]."""
        going_on = self._planner.moving or self._source is not None or self._output.blocked
        return self._output.last_u - (self._stop + DRY if going_on else 0)

    @property
    def failed(self) -> bool:
        """Whether planning ended with a fault."""
        return self._failed

    @property
    def planned_end_u(self) -> float:
        """Where what has been planned so far ends on the program's time axis [cycles]."""
        return self._planner.end_u

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
            if self._observing:
                self._interpreter.sync_positions({axis: observed[axis] for axis in self._unsettled})
                for axis in self._unsettled:
                    self._planner.position[self._slots[axis]] = observed[axis]
        elif event.kind is EventKind.PAUSED:
            self.pause_u = None
        elif event.kind is EventKind.STOPPED or (
            event.kind is EventKind.FAULT and event.code not in WARNINGS
        ):
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
        due = self._flush or self._planner.full or (lead is not None and self._hurry(lead))
        if due and self._hand_over(u, lead):
            return True
        if self._waiting_for is not None:
            return worked
        try:
            return self._read() or worked
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
        return lead < self._stop + (URGENT if more else AHEAD)

    def _hand_over(self, u: float | None, lead: float | None) -> bool:
        if self._flush:
            self._flush = False
            self._source = self._planner.close()
            return True
        want = float("inf") if u is None else max(u, self._planner.u) + self._stop + AHEAD
        self._source = self._planner.commit(want)
        if self._source is None:
            more = bool(self._queue or self._canonical)
            if self._planner.full or (
                not more and (lead is None or lead < self._stop + DRY or not self._planner.moving)
            ):
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

    def _read(self) -> bool:
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
            busy = self._planner.full or self._flush or self._waiting_for is not None
            if busy or self._source is not None or self._output.blocked:
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

    def _take_run(self) -> bool:
        """Takes lines that are alike, in columns; False where the next ones are not."""
        first = self._queue[0][0]
        window = min(self._interpreter.run_window(first), RUN)
        if window == 0:
            return False
        ahead = list(islice(self._queue, window))
        if ahead[-1][0] - first != len(ahead) - 1:
            return False
        found = self._interpreter.interpret_run([text for _, text in ahead], first)
        if found is None:
            return False
        run, taken = found
        for _ in range(taken):
            self._last_line, _ = self._queue.popleft()
        self._canonical.append(run)
        return True

    def _interpret(self) -> bool:
        """Takes one line; False where it has to wait for the executor."""
        if self._held is None and self._take_run():
            return True
        if self._held is None:
            number, text = self._queue.popleft()
            self._last_line = number
            self._held = scan_line(text, number)
        parsed = self._held
        unknown = self._interpreter.axes_to_sync(parsed)
        if unknown:
            # one capture makes all its axes unknown: asked for together, later lines need not stop for
            # the others
            unknown |= self._captured
            if self._planner.pending:
                self._flush = True
                return False
            self._settle(unknown)
            return False
        self._held = None
        self._canonical.extend(self._interpreter.interpret(parsed))
        planning_s = 0.0 if self._solving is None else self._solving.take()
        if planning_s > 0.0:
            self._reports.append(Report(ReportKind.SOLVED, parsed.number, planning_s=planning_s))
        if self._interpreter.ended:
            self._ended = True
            self._closed = True
            self._queue.clear()
        return True
