"""Canonical lines into pieces of motion and control entries for the executor."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from mckinematics.dynamics import JointDynamics

from mcserver.clearance.mounted import Exchange
from mcserver.executor.entries import Control, ControlKind
from mcserver.executor.shm.rings import ProgramRing
from mcserver.machine.machine_file import Machine
from mcserver.motion.bound import Bound
from mcserver.motion.canonical import (
    AxisLine,
    AxisOperation,
    Canonical,
    DwellGroup,
    EndLine,
    FeedGroup,
    Group,
    InputLine,
    MeshLine,
    MotionLine,
    OutputLine,
    PathBatch,
    PauseLine,
    ProbeLine,
    RapidGroup,
    SpeedGroup,
    SurfaceSpeed,
    ThreadLine,
    TorqueGroup,
    dwell_of,
    may_flow,
    moves_axes,
    one_path,
    requested_of,
)
from mcserver.motion.lookahead.leading_group import Companions
from mcserver.motion.lookahead.parallel_groups import last_bound
from mcserver.motion.lookahead.setpoint_sampling import CYCLE_ROUNDING
from mcserver.motion.pieces import Activation, LineBound, LineEdges, Piece, Rows
from mcserver.motion.planner import MotionPlanner
from mcserver.planning.beams import Beams, Power
from mcserver.planning.clearance_guard import ClearanceGuard
from mcserver.planning.motion_output import Output, then
from mcserver.planning.payload_entries import PayloadEntries
from mcserver.planning.planner_messages import PlannedLines, Report, ReportKind
from mcserver.planning.start_state import StartState

_OPERATIONS = list(AxisOperation)


class InPosition(msgspec.Struct, frozen=True):
    """The exact stop that ends a line whose motion has been planned."""

    line: int
    axes: tuple[int, ...]


class LinePlanner:
    """Plan the canonical lines of one program, one after the other.

    A line that flows becomes a segment of the lookahead window; every other one starts and ends at rest, so
    the window is closed first (``flush``).

    Args:
        sink: where rows and control entries go.
        start: where the program starts.
        dynamics: torques of the tools' joints.
        guard: holds the motion clear of bodies and zones.

    Attributes:
        motion: the lookahead window and where the plan ends.
        output: rows and control entries on their way to the executor.
        source: what is being sampled for it; None: nothing is.
        canonical: lines to be planned, in order.
        captured: axes whose encoders nobody has asked for since their capture; they stand.
        waiting_for: token of the positions that the executor was asked for; None: of none.
        reports: about the lines, for `Pipeline.take_reports`.
        flush: the window has to be closed before anything else is planned.
        pausing: a pause has been put that has not ended: nothing behind it is read.
        last_line: number of the last line that was read.
        beams: its lasers.
        pause_u: where the next M00 or M01 stands on the time axis [cycles]; None: nowhere.
    """

    def __init__(
        self,
        machine: Machine,
        sink: ProgramRing,
        start: StartState,
        dynamics: JointDynamics | None = None,
        guard: ClearanceGuard | None = None,
    ) -> None:
        self._machine = machine
        self._width = len(machine.axes)
        self._columns = {axis.index: column for column, axis in enumerate(machine.axes)}
        place = np.array([start.positions[axis.index] for axis in machine.axes])
        self.motion = MotionPlanner(machine, place, dynamics)
        self.output = Output(sink, guard)
        self.source: Iterator[Piece | Control] | None = None
        self.canonical: deque[Canonical | PathBatch | InPosition | Exchange] = deque()
        self._energized = set(start.energized)
        # axes that turn, push or move by themselves, as others have left them or by this program's order; the
        # spindle keeps its mode at rest, too
        self._unattended = set(start.unsettled | {machine.dialect.spindle} - {None})
        # axes whose exact stop is a stop: nothing comes later than its setpoints
        self._ideal = frozenset(
            axis.index
            for axis in machine.axes
            if not (axis.drive.has_inertia or machine.shaping or machine.compensated)
        )
        # axes that G1020 may still be moving
        self._independent: set[int] = set()
        self.captured: set[int] = set()
        self._unsettled: frozenset[int] = frozenset()
        self._observing = False
        self._from_rest = False
        self._tolerance = 0.0
        self._token = 0
        self.waiting_for: int | None = None
        self._exchange: Exchange | None = None
        self.reports: deque[Report | PlannedLines] = deque()
        self.flush = False
        self.pausing = False
        self.last_line = 0
        self._passed = 0
        self.pause_u: float | None = None
        # outputs by column that wait for the next motion, and those of lines whose motion is in the window
        self._due: dict[int, Power] = {}
        self._at_start: dict[int, dict[int, Power]] = {}
        self.beams = Beams(machine)
        self._payloads = PayloadEntries(machine, dynamics)

    @property
    def planned_line(self) -> int:
        """Every line through this one has been planned, or needs no time."""
        return self.canonical[0].line - 1 if self.canonical else self.last_line

    def abort(self) -> None:
        """Drop all that has not been handed over: the program was stopped."""
        self.last_line = self.planned_line
        self.canonical.clear()
        self.output.drop()
        self.source = None
        self.drop_outputs()

    def drop_outputs(self) -> None:
        """Drop outputs that wait for the next motion: the program has no more."""
        self._due.clear()

    def finish(self, *, broken: bool) -> None:
        """Put the program's end behind the motion.

        Args:
            broken: a faulty line ended it: its outputs become safe.
        """
        self._set_outputs(self._due, self.motion.u, self.last_line)
        self._due = {}
        self.control(ControlKind.FINISH, self.last_line, operation=int(broken))

    def pass_lines(self, through: int) -> bool:
        """Put a mark where the plan ends, behind which every line through this one has ended.

        It is put wherever the motion rests and the program goes on, or has nothing more for now: so each
        line, those that take no time too, counts as done when the executor has passed all of it.

        Returns:
            False where there is such a mark.
        """
        if through <= self._passed:
            return False
        self._passed = through
        self.control(ControlKind.PASSED, through)
        return True

    def settled(self, setpoints: Sequence[float]) -> dict[int, float]:
        """Take the positions that were asked for [m or rad].

        Args:
            setpoints: shape (K,), of all axes.

        Returns:
            Those that the interpreter has to know, by axis number.
        """
        self.waiting_for = None
        self._energized |= self._unsettled
        if not self._observing:
            return {}
        observed = {axis: setpoints[self._columns[axis]] for axis in self._unsettled}
        for axis, position in observed.items():
            self.motion.position[self._columns[axis]] = position
        return observed

    def take_exchange(self) -> Exchange | None:
        """Take the exchange of tools before which all has been played; None: there is none."""
        exchange, self._exchange = self._exchange, None
        return exchange

    def end_pause(self, positions: Mapping[int, float]) -> None:
        """Go on behind a pause; ``positions``: of axes that others have moved [m or rad]."""
        self.pausing = False
        self._payloads.forget()
        for axis, position in positions.items():
            self.motion.position[self._columns[axis]] = position

    def put(self, piece: Piece | Control) -> None:
        """Turn a piece of the plan into rows, control entries and reports."""
        if isinstance(piece, Rows | Control):
            self.output.put(piece)
        elif isinstance(piece, LineBound):
            bound = f"axis {self._machine.axes[piece.bound.column].index} {piece.bound.kind}"
            self.reports.append(Report(ReportKind.BOUND, piece.line, bound_by=bound))
        elif isinstance(piece, LineEdges):
            self._put_edges(piece)
        elif isinstance(piece, Activation):
            self.output.put(Control(ControlKind.BEGIN, piece.u, piece.line, axes=piece.mask))
        else:
            self.output.put(
                Control(ControlKind.END, piece.u, piece.line, axes=piece.mask, values=piece.position)
            )

    def _put_edges(self, edges: LineEdges) -> None:
        """Put where lines begin and end, with what comes along at their beginnings."""
        passed = 0
        outputs, payloads = self._at_start, self._payloads.lines
        lines = edges.line.tolist() if outputs or payloads else ()
        noted = [index for index, line in enumerate(lines) if line in outputs or line in payloads]
        for index in noted:
            if edges.ends[index]:
                continue
            u, line = float(edges.u[index]), lines[index]
            self.output.put(edges.part(slice(passed, index)))
            for entry in self._payloads.at(u, line):
                self.output.put(entry)
            passed = index + 1
            self.output.put(edges.part(slice(index, passed)))
            self._set_outputs(self._at_start.pop(line, {}), u, line)
        self.output.put(edges.part(slice(passed, len(edges))))

    def settle(self, axes: frozenset[int]) -> None:
        """Ask the executor to bring axes to rest and to report their positions (D-14, D-25)."""
        self.motion.to_whole_cycle()
        self.control(ControlKind.HALT_AXES, self.last_line, axes=self._mask(axes))
        self._independent -= axes
        self._unattended -= axes
        self.captured -= axes
        self._await_settled(axes, observing=True)

    def _await_settled(self, axes: frozenset[int], *, observing: bool) -> None:
        self._token += 1
        self._observing = observing
        self._unsettled = axes
        self.waiting_for = self._token
        self.control(ControlKind.SETTLE, self.last_line, axes=self._mask(axes), token=self._token)
        self.output.flush()

    def step(self) -> bool:
        """Plan the next canonical line; False where the window has to be closed first."""
        line = self.canonical[0]
        if not self.motion.pending:
            self.pass_lines(line.line - 1)
        if isinstance(line, OutputLine) and line.with_motion:
            self.canonical.popleft()
            self._due.update(self.beams.take(line.settings))
            return True
        if isinstance(line, PathBatch):
            self.canonical.popleft()
            if self._flow_on(line):
                self._note_outputs(line.line, {})
                for number, powers in self.beams.along(line):
                    self._note_outputs(number, powers)
            else:
                self.canonical.extendleft(reversed(line.values()))
            return True
        if isinstance(line, MotionLine) and moves_axes(line):
            self._note_outputs(line.line, self.beams.changes_with(line))
        if isinstance(line, MotionLine) and may_flow(line):
            self.canonical.popleft()
            if self._flow(line):
                return True
            self.canonical.appendleft(line)
        if self.motion.pending:
            self.flush = True
            return False
        self._from_rest = False
        self.canonical.popleft()
        if isinstance(line, MotionLine):
            self._stand(line)
        elif isinstance(line, InPosition):
            self.motion.to_whole_cycle()
            self.output.put(self._wait(line.line, line.axes))
            self.control(ControlKind.LINE_END, line.line)
        elif isinstance(line, AxisLine):
            self._axis_line(line)
        elif isinstance(line, ProbeLine):
            self._probe(line)
        elif isinstance(line, MeshLine):
            self._mesh(line)
        elif isinstance(line, ThreadLine):
            self._thread(line)
        elif isinstance(line, PauseLine):
            self.motion.to_whole_cycle()
            self.pause_u = self.motion.u
            self.pausing = True
            self.control(ControlKind.PAUSE, line.line)
        elif isinstance(line, Exchange):
            # bodies are others once the motion before has been played
            self.motion.to_whole_cycle()
            self._exchange = line
            if line.fitted is not None:
                self.control(ControlKind.TOOL, line.line, operation=line.fitted)
            if line.advance is not None:
                self.control(ControlKind.ADVANCE, line.line, value=line.advance)
            self._await_settled(frozenset(), observing=False)
        elif isinstance(line, OutputLine):
            self._set_now(line)
        elif isinstance(line, InputLine):
            self._read_input(line)
        elif isinstance(line, EndLine):
            self.last_line = line.line
        return True

    def _note_outputs(self, line: int, powers: Mapping[int, Power]) -> None:
        """Have outputs set as the motion of a line begins, with those that wait for the next motion."""
        due = {**self._due, **powers}
        if due:
            self._at_start[line] = {**self._at_start.get(line, {}), **due}
            self._due = {}

    def _set_now(self, line: OutputLine) -> None:
        """Set outputs where the motion before them has ended (D-71)."""
        self.motion.to_whole_cycle()
        settings = self.beams.take(line.settings)
        # what was to come with the next motion came first in the program
        self._due = {column: value for column, value in self._due.items() if column not in settings}
        self._set_outputs(settings, self.motion.u, line.line)

    def _set_outputs(self, settings: Mapping[int, Power], u: float, line: int) -> None:
        for column, power in settings.items():
            self.output.put(
                Control(
                    ControlKind.OUTPUT,
                    u,
                    line,
                    channel=column,
                    value=power.value,
                    axes=power.axes,
                    seconds=power.speed,
                )
            )

    def _read_input(self, line: InputLine) -> None:
        """Have an input read, or waited for, where the motion before it has ended (D-72)."""
        self.motion.to_whole_cycle()
        self.reports.append(Report(ReportKind.PLANNED, line.line))
        self.control(ControlKind.LINE_START, line.line)
        self.control(
            ControlKind.INPUT,
            line.line,
            channel=line.column,
            operation=int(line.mode),
            seconds=line.timeout,
        )
        self.control(ControlKind.LINE_END, line.line)

    def _report(self, line: MotionLine) -> None:
        self.reports.append(
            Report(
                ReportKind.PLANNED,
                line.line,
                requested_s=requested_of(line),
                feed_length=line.feed_length,
                dwell_s=dwell_of(line),
            )
        )

    def _flow_on(self, run: PathBatch) -> bool:
        """Append a batch to the window at once; False where they have to go one by one."""
        loose = not self._energized.issuperset(run.axes) or self._independent.intersection(run.axes)
        if loose or run.exact_stop:
            return False
        tolerance = min(self._tolerance, float(run.tolerances[0]))
        if not self.motion.append_run(run, from_rest=self._from_rest, tolerance=tolerance):
            return False
        self.reports.append(PlannedLines(run.lines, run.requested, run.travels))
        self._tolerance = float(run.tolerances[-1])
        self._from_rest = False
        return True

    def _flow(self, line: MotionLine) -> bool:
        """Append the line to the window as a segment, with what runs beside it; False where it does not
        travel, an axis does not hold, or none of its groups is sure to end last."""
        group = one_path(line)
        feeds = [each for each in line.groups if isinstance(each, FeedGroup)]
        axes = tuple(axis for each in feeds for axis in each.axes)
        if not self._energized.issuperset(axes) or self._independent.intersection(axes):
            return False
        companions: Companions | None = None
        if group is not None:
            segment = self.motion.segment(group, line.line)
            if not segment.travels:
                return False
        else:
            found = self.motion.comma_line(feeds, line.line, line.tolerance)
            if found is None:
                return False
            segment, companions = found.segment, found.companions
        self._payloads.note(line)
        self._report(line)
        tolerance = min(self._tolerance, line.tolerance)
        self.motion.append(segment, from_rest=self._from_rest, tolerance=tolerance, companions=companions)
        self._tolerance = line.tolerance
        # with drives that follow in the same cycle an exact stop is a stop, and waits for nothing
        self._from_rest = line.exact_stop
        if line.exact_stop and not self._ideal.issuperset(axes):
            segment.closes = False
            self.canonical.appendleft(InPosition(line.line, axes))
            self.flush = True
        return True

    def _stand(self, line: MotionLine) -> None:
        """Plan a line that starts and ends at rest: rapids, dwells, comma groups, speeds and torques."""
        planner = self.motion
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
        self._payloads.note(line)
        for entry in self._payloads.at(planner.u, line.line):
            self.output.put(entry)
        self.control(ControlKind.LINE_START, line.line)
        for group in line.groups:
            self._transmit(group, line.line)
        # behind what energizes axes: outputs come with the motion itself
        self._set_outputs(self._at_start.pop(line.line, {}), planner.u, line.line)
        end = start
        bound: Bound | None = None
        if feeds:
            pieces, runs, end = planner.together(feeds, line.line)
            bound = last_bound(runs)
            if bound is not None:
                self.put(LineBound(line.line, bound))
        # what lasts without moving: a dwell beside other groups, a G93 line without travel (D-30)
        lasting = [group.duration or 0.0 for group in feeds]
        dwells = [group.seconds for group in line.groups if isinstance(group, DwellGroup)]
        alone = dwell_of(line)
        end = max(end, start + max(lasting + ([] if alone else dwells), default=0.0) * self._machine.cycle_hz)
        if feeds and any(run is not None for run in runs):
            self.source = pieces
        planner.u = max(planner.u, end)
        after: list[Control] = []
        if alone:
            # whole cycles are waited for; the rest of the dwell is a part of the time axis, so that what
            # follows is still sampled at the cycle
            cycles = math.floor(alone * self._machine.cycle_hz + CYCLE_ROUNDING)
            seconds = cycles * self._machine.cycle_s
            if cycles:
                after.append(Control(ControlKind.DWELL, planner.u, line.line, seconds=seconds))
            planner.rest(max(0.0, alone * self._machine.cycle_hz - cycles))
            end = planner.u
        if waits:
            planner.to_whole_cycle()
            end = planner.u
            after.append(self._wait(line.line, tuple(sorted(waits))))
            self._independent -= waits
        after.append(Control(ControlKind.LINE_END, end, line.line))
        self.source = then(self.source, after)

    def _transmit(self, group: Group, line: int) -> None:
        """Start what the executor does by itself: independent motion, speed, torque."""
        surface: SurfaceSpeed | None = None
        if isinstance(group, RapidGroup):
            kind, values = ControlKind.RAPID, group.targets
            for axis, target in zip(group.axes, group.targets, strict=True):
                self.motion.position[self._columns[axis]] = target
            self._independent |= set(group.axes)
            self._unattended -= set(group.axes)
        elif isinstance(group, SpeedGroup):
            kind, values = ControlKind.SPEED, group.velocities
            self._unattended |= set(group.axes)
            surface = group.surface
            self._independent -= set(group.axes)
        elif isinstance(group, TorqueGroup):
            kind, values = ControlKind.TORQUE, group.torques
            self._unattended |= set(group.axes)
            self._independent -= set(group.axes)
        else:
            return
        self._energized |= set(group.axes)
        self.captured -= set(group.axes)
        row = [0.0] * self._width
        for axis, value in zip(group.axes, values, strict=True):
            row[self._columns[axis]] = value
        more: dict[str, Any] = {}
        if surface is not None:
            leads = self._columns[surface.axis]
            row[leads] = surface.zero
            more = {
                "channel": leads,
                "operation": 1,
                "seconds": surface.speed,
                "value": surface.greatest,
            }
        self.control(kind, line, axes=self._mask(group.axes), values=tuple(row), **more)

    def _axis_line(self, line: AxisLine) -> None:
        """Put axis commands behind the motion of their axes (D-40, D-130)."""
        # the executor reports its end, as that of motion
        self.reports.append(Report(ReportKind.PLANNED, line.line))
        self.motion.to_whole_cycle()
        if line.operation is not AxisOperation.CAPTURE:
            # the last setpoint reaches the drives before they are commanded to let go
            self.motion.rest(1.0)
        self._end_independent(line.line, line.axes)
        self.control(
            ControlKind.AXIS,
            line.line,
            axes=self._mask(line.axes),
            operation=_OPERATIONS.index(line.operation),
        )
        if line.operation.energized:
            known = self._energized
            if line.operation is AxisOperation.CAPTURE:
                # it changes nothing of axes that hold already: they are asked for with the others
                known = known & self._unattended
            self.captured |= set(line.axes) - known
            self._energized |= set(line.axes)
        else:
            self.captured -= set(line.axes)
            if line.operation.energized is False:
                self._energized -= set(line.axes)
        if line.operation is AxisOperation.UNCOUPLE:
            self.captured |= self._energized.intersection(line.axes)
        if self.captured and line.operation in (AxisOperation.CAPTURE, AxisOperation.UNCOUPLE):
            # asked for now, while everything rests: a later line that needs the reading need not
            # stop for it
            self.settle(frozenset(self.captured))

    def _probe(self, line: ProbeLine) -> None:
        """Let the executor probe; where that ends is where later lines start."""
        self.reports.append(
            Report(ReportKind.PLANNED, line.line, requested_s=line.requested, feed_length=line.length)
        )
        self._go_straight(
            ControlKind.PROBE,
            line.line,
            line.axes,
            line.targets,
            seconds=line.speed,
            operation=int(line.kind),
            token=int(line.mesh),
        )
        self.control(ControlKind.LINE_END, line.line)
        if line.mesh:
            # what is behind it goes by rapids, wherever it ended
            return
        self._await_settled(frozenset(line.axes), observing=True)

    def _mesh(self, line: MeshLine) -> None:
        """Have the mesh of the bed count otherwise where its axes rest, and wait until they are there."""
        self.reports.append(Report(ReportKind.PLANNED, line.line))
        self._begin_at_rest(line.line, line.axes)
        self.control(ControlKind.MESH, line.line, axes=self._mask(line.axes), operation=int(line.use))
        self.output.put(self._wait(line.line, line.axes))
        self.control(ControlKind.LINE_END, line.line)

    def _thread(self, line: ThreadLine) -> None:
        """Let the executor follow the spindle to the end of a pass (D-89)."""
        self.reports.append(
            Report(ReportKind.PLANNED, line.line, requested_s=line.requested, feed_length=line.travel)
        )
        self._go_straight(
            ControlKind.THREAD,
            line.line,
            line.axes,
            line.targets,
            seconds=line.pitch,
            channel=self._columns[line.spindle],
            value=line.turns_s,
            operation=int(line.taps),
        )
        for axis, target in zip(line.axes, () if line.taps else line.targets, strict=not line.taps):
            self.motion.position[self._columns[axis]] = target
        self.output.put(self._wait(line.line, line.axes))
        self.control(ControlKind.LINE_END, line.line)

    def _go_straight(
        self, kind: ControlKind, line: int, axes: tuple[int, ...], targets: tuple[float, ...], **more: Any
    ) -> None:
        """Begin a line whose motion along a straight way is the executor's."""
        self._begin_at_rest(line, axes)
        row = [0.0] * self._width
        for axis, target in zip(axes, targets, strict=True):
            row[self._columns[axis]] = target
        self.control(kind, line, axes=self._mask(axes), values=tuple(row), **more)

    def _begin_at_rest(self, line: int, axes: tuple[int, ...]) -> None:
        """Begin a line where independent motion of its axes has ended."""
        self.motion.to_whole_cycle()
        self._end_independent(line, axes)
        self.control(ControlKind.LINE_START, line)

    def _end_independent(self, line: int, axes: tuple[int, ...]) -> None:
        """Wait until independent motion of axes has ended."""
        moving = tuple(sorted(self._independent.intersection(axes)))
        if moving:
            self.output.put(self._wait(line, moving))
            self._independent -= set(moving)

    def _ask_energized(self, line: MotionLine, axes: frozenset[int]) -> None:
        """Have the executor check axes that no capture of this program holds (D-27): it faults, or they
        hold."""
        self.control(ControlKind.BEGIN, line.line, axes=self._mask(axes))
        self.canonical.appendleft(line)
        self._await_settled(axes, observing=False)

    def _wait(self, line: int, axes: tuple[int, ...]) -> Control:
        return Control(
            ControlKind.WAIT,
            self.motion.u,
            line,
            axes=self._mask(axes),
            seconds=self._machine.exact_stop_timeout,
        )

    def _mask(self, axes: Iterable[int]) -> int:
        return sum(1 << self._columns[axis] for axis in set(axes))

    def control(self, kind: ControlKind, line: int, **more: Any) -> None:
        """Put a control entry where the plan ends."""
        self.output.put(Control(kind, self.motion.u, line, **more))
