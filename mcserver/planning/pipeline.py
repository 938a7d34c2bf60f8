"""Turn one program from lines of text into setpoint rows: read, interpret, plan, hand over.

Plain code without threads or clocks: `pump` does a bounded piece of work and says whether there is more. The
planner's process calls it in turn with other programs, `mcserver simulate` between the cycles of its virtual
clock.
"""

from __future__ import annotations

import enum
import time
from collections import deque
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
from mckinematics.pose import Kinematics
from numpy.typing import NDArray

from mcserver.clearance.mounted import Exchange
from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.executor.entries import Control, EventKind, ExecutorEvent
from mcserver.executor.fault_codes import WARNINGS, FaultCode
from mcserver.executor.shm.rings import ProgramRing
from mcserver.executor.stopping import stopping_rows
from mcserver.gcode.computing.machine_values import Unsettled
from mcserver.gcode.computing.macro_expansion import expansion_of
from mcserver.gcode.notices import notice_of
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.interpreter import Interpreter, without_pause
from mcserver.gcode.text.parser import ParsedLine
from mcserver.machine.machine_file import Machine
from mcserver.motion.bound import PlanningError
from mcserver.motion.canonical import Canonical, PathBatch, PauseLine
from mcserver.motion.pieces import Rows
from mcserver.planning.clearance_guard import ClearanceGuard
from mcserver.planning.exchanges import Exchanges, changes_setpoints
from mcserver.planning.line_buffer import LineBuffer
from mcserver.planning.line_planner import LinePlanner
from mcserver.planning.motion_output import LAST_TOKEN
from mcserver.planning.planner_messages import PlannedLines, Report, ReportKind
from mcserver.planning.solving_time import TimedKinematics
from mcserver.planning.start_state import PauseEnd, StartState

# The horizon: when the executor has fewer rows ahead than LOW beyond those that a stop needs, motion is
# handed over up to HIGH beyond them [cycles]. So a planner that is late by less than LOW slows nothing down.
# Motion that is not handed over can still be joined with later lines, and planned for an override above
# 100 %.
HORIZON_LOW, HORIZON_HIGH = 100, 120
# Least values of the same with the rows of the stop included [cycles].
LEAST_LOW, LEAST_HIGH = 200, 220
# The longest stop that is provided for: the ring of rows has to hold it [cycles].
LONGEST_STOP = 2500
# Below this lead the stop at the window's end is handed over too: no more lines came in time [cycles].
DRY = 40
# Lines read in one piece of work.
BITE = 64
# Lines that are read in columns at once: a piece of work of some milliseconds.
RUN = 512
# Number of the lines that bring the axes to where the first line starts.
APPROACH_LINE = 0
# Segments in the window that a program at rest waits for before its first motion, while lines are queued.
FIRST_WINDOW = 64


class FaultRule(enum.Enum):
    """Effect of a faulty line on its program; nothing of the line itself moves (D-04)."""

    END = "end"  # the program ends before it, as a file does that is run as a whole
    RETRY = "retry"  # its number is expected again, corrected, while more lines may come


class Phase(enum.Enum):
    """Phase of a pipeline."""

    PLANNING = "planning"
    FINISHED = "finished"  # the end of the program is on its way to the executor
    ABORTED = "aborted"  # the executor has stopped the program


class Pipeline:
    """Plan one program.

    Args:
        start: the state that it starts from.
        lines: the program's text; None: a buffer of its own.
        lease: axes that the program may name; None: all.
        on_fault: effect of a faulty line.
        clock: for the time of inverse kinematics [s].
        machine_coordinates: lines are in positions of the axes, relative to the reference.
        approach: lines in machine coordinates that run before the first one, as line 0.
        guard: checks the motion for contacts. controls: the entries of a program that has no lines.
    """

    def __init__(
        self,
        machine: Machine,
        sink: ProgramRing,
        *,
        start: StartState,
        lines: LineBuffer | None = None,
        kinematics: Kinematics | None = None,
        lease: frozenset[int] | None = None,
        on_fault: FaultRule = FaultRule.END,
        clock: Callable[[], float] = time.perf_counter,
        machine_coordinates: bool = False,
        approach: Sequence[str] = (),
        guard: ClearanceGuard | None = None,
        controls: Sequence[Control] = (),
    ) -> None:
        self.lines = LineBuffer() if lines is None else lines
        dynamics = None if kinematics is None else kinematics.dynamics
        self._plan = LinePlanner(machine, sink, start, dynamics, guard)
        self._guard = guard
        self._sink = sink
        self._width = len(machine.axes)
        self._on_fault = on_fault
        self._solving = None if kinematics is None else TimedKinematics(kinematics, clock)
        self._interpreter = Interpreter(
            machine,
            kinematics=self._solving,
            positions=start.positions,
            lease=lease,
            modal=start.modal,
            frame=start.frame,
            machine_coordinates=machine_coordinates or bool(approach),
            switches=start.switches,
        )
        self._expansion = expansion_of(self._interpreter)
        self._lasting = self._expansion.lasting
        # a jog leaves the pressure advance K to the print that it runs beside, or in a pause of
        leads = not machine_coordinates and (lease is None or machine.dialect.extruder in lease)
        judged = machine.clearance is not None or changes_setpoints(machine)
        self._exchanges = Exchanges(machine, self._interpreter.frame, leads=leads) if judged else None
        self._columns = [axis.index for axis in machine.axes]
        self._approach = deque(approach)
        self._machine_coordinates = machine_coordinates
        self._printer = machine.dialect.profile == "printer"
        self._frame = self._interpreter.frame
        # a line that is read, and interpreted once the executor has reported positions or a pause has ended
        self._held: ParsedLine | None = None
        # the line whose pause has been put and comes before the rest of it
        self._paused: ParsedLine | None = None
        self._phase = Phase.FINISHED if controls else Phase.PLANNING
        for control in controls:
            self._plan.output.put(control)
        # a faulty line has ended the program
        self._broken = False
        # the program that is waited for, and the line at which that was last reported
        self._waited = ("", 0)

    # ------------------------------------------------------------------ state

    @property
    def _stop(self) -> int:
        """Rows that the executor needs ahead in order not to slow down for their end."""
        return min(stopping_rows(self._sink.stop_ahead()), LONGEST_STOP)

    def abort(self) -> None:
        """Drop all motion that has not been handed over: the program was stopped."""
        self._phase = Phase.ABORTED
        self._end_of_text()
        self._plan.abort()

    @property
    def waiting(self) -> bool:
        """Whether planning waits for the executor to report positions."""
        return self._plan.waiting_for is not None

    @property
    def playable_u(self) -> float:
        """u up to which the executor may play before the next `pump` without beginning to stop [cycles]."""
        plan = self._plan
        going_on = plan.motion.moving or plan.source is not None or plan.output.blocked
        return plan.output.last_u - (self._stop + DRY if going_on else 0)

    @property
    def pause_u(self) -> float | None:
        """u of the next pause, such as M00 or M01 [cycles]; None without one."""
        return self._plan.pause_u

    @property
    def planned_line(self) -> int:
        """Last line through which all lines have been read without fault, and planned if they take time."""
        if self._plan.canonical or self._held is None:
            return self._passable(self._plan.planned_line)
        return self._passable(self._plan.last_line - 1)

    def _passable(self, line: int) -> int:
        """Return the last line up to ``line`` that precedes what the interpreter holds (D-85)."""
        held = self._interpreter.held_line
        return line if held is None else min(line, held - 1)

    @property
    def planned_end_u(self) -> float:
        """End of the planned motion on the program's time axis [cycles]."""
        return self._plan.motion.end_u

    def take_reports(self) -> list[Report]:
        """Take the reports since the last call."""
        found: list[Report] = []
        for report in self.take_reports_in_columns():
            if isinstance(report, PlannedLines):
                found += report.reports()
            else:
                found.append(report)
        return found

    def take_reports_in_columns(self) -> list[Report | PlannedLines]:
        """Take the reports since the last call, with those of batches as columns."""
        reports = list(self._plan.reports)
        self._plan.reports.clear()
        return reports

    def on_event(self, event: ExecutorEvent) -> None:
        """Take an event of this program's slot."""
        if self._guard is not None:
            self._guard.on_event(event)
            # a motion at rest with few rows left does not begin again
            last = event.kind is EventKind.SETTLED and event.token == LAST_TOKEN
            # the program was held because a zone was switched on around a body
            met = event.kind is EventKind.FAULT and event.code == FaultCode.ZONE_HOLD
            if last or met or event.kind is EventKind.STARVED:
                self._say_contact()
        if event.kind is EventKind.SETTLED and event.token == self._plan.waiting_for:
            observed = self._plan.settled(event.values[: self._width])
            if observed:
                self._interpreter.sync_positions(observed)
            self._exchange()
        elif event.kind is EventKind.PROBED:
            place = dict(zip(self._columns, event.values, strict=True))
            self._expansion.measured.probed(place, tripped=event.token == 1)
        elif event.kind is EventKind.INPUT:
            self._expansion.measured.input_read(event.values[0])
        elif event.kind is EventKind.PAUSED:
            self._plan.pause_u = None
        elif event.kind is EventKind.STOPPED or (
            event.kind is EventKind.FAULT and event.code not in WARNINGS
        ):
            self.abort()

    def _exchange(self) -> None:
        """Exchange tools that have bodies; all motion before has been played."""
        exchange = self._plan.take_exchange()
        if exchange is None:
            return
        self._plan.reports.append(Report(ReportKind.EXCHANGED, exchange.line, exchange=exchange))
        if self._guard is not None:
            self._guard.exchange(exchange)
            self._say_contact()

    def _say_contact(self) -> None:
        """Report the contact before which the program ends, if there is one."""
        contact = None if self._guard is None else self._guard.contact
        if contact is not None:
            self._plan.reports.append(Report(ReportKind.CONTACT, contact.line, diagnostics=(contact,)))

    def end_pause(self, end: PauseEnd) -> None:
        """Go on after the pause at which the program stands, from the present positions of the axes.

        No line after the pause has been interpreted, so the present work offsets and tools apply.
        """
        if not self._plan.pausing:
            return
        self._plan.end_pause(end.positions)
        self._interpreter.end_pause(end.positions, end.frame)
        # whoever changed the work offsets has reported them already
        self._frame = self._interpreter.frame
        if self._guard is not None:
            self._guard.stand(end.positions)

    # ------------------------------------------------------------------ work

    def pump(self, u: float | None = None, override: float = 1.0) -> bool:
        """Do a bounded piece of work.

        Args:
            u: where the executor is on this program's time axis [cycles]; None on a virtual clock: then
                nothing is handed over before the window is full or closed.
            override: the feed override, 1 as programmed; above 1 it multiplies the F that is planned.

        Returns:
            True if something was done.
        """
        plan = self._plan
        if self._guard is not None:
            self._guard.refresh()
        plan.motion.feed_scale = max(1.0, override)
        worked = plan.output.flush()
        self._say_wait()
        if plan.output.blocked or self._phase is Phase.ABORTED:
            return worked
        if self._guard is not None and self._guard.contact is not None:
            plan.source = None
            return worked
        if plan.source is not None:
            return self._draw() or worked
        if self._phase is Phase.FINISHED:
            return worked
        lead = None if u is None else plan.motion.u - u
        due = plan.flush or plan.motion.full
        if due and lead is not None and plan.motion.pending:
            # not needed yet: an override that comes meanwhile can still be planned in
            due = False
        if (due or (lead is not None and self._hurry(lead))) and self._hand_over(u, lead):
            return True
        if plan.flush or plan.waiting_for is not None or plan.pausing or plan.motion.full:
            return worked
        try:
            return self._read() or worked
        except ProgramRejected as rejected:
            self._reject(rejected)
            return True
        except PlanningError as error:
            if error.line == APPROACH_LINE:
                raise
            fault = Diagnostic(
                code="MC290",
                line=error.line,
                message="no velocity profile keeps all limits on this line",
                hint="give the line a lower F, or stop before it with G09 on the line above",
            )
            self._reject(ProgramRejected([fault]))
            return True

    def _say_wait(self) -> None:
        """Report the program that is waited for, once per line, and the end of waiting."""
        if self._guard is None:
            return
        waiting, line = self._guard.waiting, self._waited[1]
        fault = waiting.fault
        now = (waiting.program, line if fault is None else fault.line)
        if now == self._waited:
            return
        said = () if fault is None or now[1] == line else (fault,)
        self._waited = now
        self._plan.reports.append(
            Report(ReportKind.WAITING, now[1], diagnostics=said, waits_for=waiting.program)
        )

    @property
    def _more(self) -> bool:
        """Whether lines wait that could be joined to the motion in the window."""
        return bool(self.lines.ready or self._plan.canonical or self._expansion.running)

    def _hurry(self, lead: float) -> bool:
        """Return whether motion has to be handed over now."""
        motion = self._plan.motion
        if not motion.pending:
            return False
        more = self._more and not self._plan.flush
        if more and not motion.moving:
            # a start from rest: waiting for more lines delays it, but makes it faster
            return motion.pending >= FIRST_WINDOW
        return lead < max(self._stop + HORIZON_LOW, LEAST_LOW)

    def _hand_over(self, u: float | None, lead: float | None) -> bool:
        plan, motion = self._plan, self._plan.motion
        want = float("inf") if u is None else u + max(self._stop + HORIZON_HIGH, LEAST_HIGH)
        if plan.flush:
            if u is not None:
                plan.source = motion.commit(want, closing=True)
            if plan.source is None:
                plan.flush = False
                plan.source = motion.close()
            return True
        plan.source = motion.commit(want)
        if plan.source is None:
            dry = lead is None or lead < self._stop + DRY or not motion.moving
            if motion.full or (not self._more and dry):
                plan.source = motion.close()
        return plan.source is not None

    def _draw(self) -> bool:
        plan = self._plan
        assert plan.source is not None
        for piece in plan.source:
            plan.put(piece)
            if isinstance(piece, Rows):
                plan.output.flush()
                return True
        plan.source = None
        plan.output.flush()
        return True

    def _reject(self, rejected: ProgramRejected) -> None:
        """End the program before a faulty line: what was planned before it runs to its stop, nothing of it
        and nothing after it."""
        plan = self._plan
        line = rejected.diagnostics[0].line
        if line == APPROACH_LINE:
            # nobody can correct an approach, and the program must not begin from another position
            raise rejected
        # steps of a block ahead of the fault may have set parameters
        self._note_frame(plan.last_line)
        plan.reports.append(Report(ReportKind.REJECTED, line, diagnostics=rejected.diagnostics))
        # a block of O-words has been executed in part only
        plan.last_line = self._passable((self._expansion.head or line) - 1)
        # a move that cutter compensation holds back is dropped: its end depends on the faulty line
        self._interpreter.finish()
        self._end_of_text()
        self._broken = True
        plan.canonical.clear()
        plan.drop_outputs()
        self._held = None
        plan.flush = plan.motion.pending > 0

    # ------------------------------------------------------------------ lines

    def _read(self) -> bool:
        plan = self._plan
        worked = False
        for _ in range(BITE):
            if plan.canonical:
                if not plan.step():
                    return True
                worked = True
            elif self._held is not None or self._expansion.running or self.lines.ready:
                if not self._interpret():
                    return True
                worked = True
            else:
                break
            busy = plan.motion.full or plan.flush or plan.waiting_for is not None or plan.pausing
            if busy or plan.source is not None or plan.output.blocked:
                return True
        running = self._held is not None or self._expansion.running
        if not plan.canonical and not self.lines and not running and self.lines.closed:
            self._expansion.close()
            if self._expansion.running:
                return True
            self._interpreter.check_closed()
            plan.canonical.extend(self._interpreter.finish())
            if plan.canonical:
                return True
            if plan.motion.pending:
                plan.flush = True
                return True
            plan.finish(broken=self._broken)
            self._phase = Phase.FINISHED
            plan.output.flush()
            plan.reports.append(Report(ReportKind.FINISHED, plan.last_line))
            return True
        idle = not (plan.canonical or running or plan.motion.pending or self.lines.ready)
        if idle and plan.pass_lines(self._passable(plan.last_line)):
            plan.output.flush()
            return True
        return worked

    def _take_run(self) -> bool:
        """Read lines of the same form, in columns; return False where the next lines are not."""
        first = self.lines.next_number
        window = min(self._interpreter.batch_window(first), RUN)
        if window == 0:
            return False
        ahead = self.lines.run(window)
        found = self._interpreter.interpret_batch(ahead, first) if ahead else None
        if found is None:
            return False
        self._expansion.passed(ahead[: found.taken], first)
        self.lines.drop(found.taken)
        self._plan.last_line = self.lines.consumed
        self._plan.canonical += [*self._exchanged_by(first), *found.values]
        for each in found.values:
            if isinstance(each, PathBatch):
                self._note_solving(each.lines)
        self._note_frame(self._plan.last_line)
        return True

    def _note_solving(self, lines: Sequence[int] | NDArray[np.int64]) -> None:
        """Report the time of inverse kinematics for lines that were solved together."""
        spent = 0.0 if self._solving is None else self._solving.take() / len(lines)
        if spent > 0.0:
            reports = [Report(ReportKind.SOLVED, int(line), planning_s=spent) for line in lines]
            self._plan.reports += reports

    def _interpret(self) -> bool:
        """Interpret one line; False where it has to wait for the executor, or is to be sent again."""
        try:
            return self._interpret_next()
        except ProgramRejected as rejected:
            faulty = rejected.diagnostics[0].line
            begun = self._expansion.in_block
            if self.lines.closed or self._on_fault is FaultRule.END or faulty == APPROACH_LINE or begun:
                raise
            # neither modal state nor motion has changed: the program goes on with the same number
            self._plan.reports.append(Report(ReportKind.REJECTED, faulty, diagnostics=rejected.diagnostics))
            self.lines.clear()
            self._held = None
            if not self._expansion.head:
                self._expansion.drop()
            self._plan.last_line = (self._expansion.head or faulty) - 1
            return False

    def _interpret_next(self) -> bool:
        plan = self._plan
        if self._held is None and self._approach:
            self._held = self._interpreter.parse(self._approach.popleft(), APPROACH_LINE)
        if self._held is None and not self._machine_coordinates:
            self._interpreter.begin_program()
        if self._held is None and self._expansion.idle and self._take_run():
            return True
        if self._held is None:
            expanded = self._expand()
            if not isinstance(expanded, ParsedLine):
                self._note_frame(plan.last_line)
                return expanded
            self._held = expanded
        parsed = self._held
        capture = self._interpreter.capture_before(parsed)
        if capture is not None:
            plan.canonical.append(capture)
            return True
        unknown = self._interpreter.axes_to_sync(parsed)
        if unknown:
            # a capture leaves the positions of all its axes unknown: ask for all at once, so that later
            # lines need not stop for the others
            return self._settle(unknown | plan.captured, parsed.number)
        values: Sequence[Canonical]
        if parsed is not self._paused:
            values = self._interpreter.pause_before(parsed)
            if values:
                # the rest of the line is interpreted when the pause has ended
                self._paused = parsed
                pause = values[0]
                if self._exchanges is not None and isinstance(pause, PauseLine):
                    plan.canonical.extend(self._exchanges.asked_for(pause))
                plan.canonical.extend(values)
                self._say(parsed, values)
                return True
        self._held = None
        values = self._interpreter.interpret(parsed)
        self._expansion.measured.interpreted(values)
        if parsed is self._paused:
            values = without_pause(values)
        else:
            self._say(parsed, values)
        plan.canonical += [*self._exchanged_by(parsed.number), *values]
        self._note_solving((parsed.number,))
        self._note_frame(parsed.number)
        if self._interpreter.ended:
            self._end_of_text()
        return True

    def _exchanged_by(self, line: int) -> list[Exchange]:
        """Return the exchanges of tools with bodies that the interpreted line makes."""
        return [] if self._exchanges is None else self._exchanges.by(line, self._interpreter.modal)

    def _say(self, parsed: ParsedLine, values: Sequence[Canonical]) -> None:
        """Report a line's message to the operator."""
        message = notice_of(parsed.text, values, printer=self._printer)
        if message is not None:
            tool = next((each.tool for each in values if isinstance(each, PauseLine)), None)
            self._plan.reports.append(Report(ReportKind.MESSAGE, parsed.number, message=message, tool=tool))

    def _expand(self) -> ParsedLine | bool:
        """Expand O-words to the next plain line.

        Returns:
            True where there was none in this piece of work, False where the motion before has to end first.
        """
        plan, expansion = self._plan, self._expansion
        if not expansion.running:
            number, text = self.lines.take()
            plan.last_line = number if expansion.idle else expansion.head - 1
            expansion.take(text, number)
            if expansion.head:
                plan.last_line = expansion.head - 1
        found = expansion.next()
        if not expansion.head or expansion.through < expansion.head:
            plan.last_line = max(plan.last_line, expansion.through)
        if isinstance(found, Unsettled):
            return self._settle(found.axes | plan.captured, expansion.head or expansion.through)
        # a long computation goes on in the next piece of work
        return not expansion.running if found is None else found

    def _settle(self, axes: frozenset[int] | set[int], line: int) -> bool:
        """Ask for positions of axes, for a line that needs them, when the motion before it has ended."""
        if self._plan.motion.pending:
            self._plan.flush = True
            return False
        self._plan.pass_lines(self._passable(line - 1))
        self._plan.settle(frozenset(axes))
        return False

    def _note_frame(self, line: int) -> None:
        """Report the work offsets, and parameters that stay, where they have changed."""
        frame, lasting = self._interpreter.frame, self._expansion.lasting
        if frame is not self._frame or lasting is not self._lasting:
            self._frame, self._lasting = frame, lasting
            frame = msgspec.structs.replace(frame or Frame(), parameters=lasting)
            self._plan.reports.append(Report(ReportKind.FRAME, line, frame=frame))

    def _end_of_text(self) -> None:
        self.lines.closed = True
        self.lines.clear()
        self._expansion.drop()
