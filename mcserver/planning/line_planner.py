"""Canonical lines into pieces of motion and control entries for the executor."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import numpy as np

from mcserver.executor.entries import Control, ControlKind, MotionSink
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
    MotionLine,
    PauseLine,
    PlainRun,
    RapidGroup,
    SpeedGroup,
    TorqueGroup,
    requested_of,
)
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.pieces import Activation, Deactivation, LineBound, LineMark, Piece
from mcserver.motion.planner import MotionPlanner
from mcserver.motion.profile.setpoint_sampling import CYCLE_ROUNDING, Rows
from mcserver.planning.motion_output import Output
from mcserver.planning.pipeline_reports import Report, ReportKind

_OPERATIONS = list(AxisOperation)


class InPosition(msgspec.Struct, frozen=True):
    """The exact stop that ends a line whose motion has been planned."""

    line: int
    axes: tuple[int, ...]


def then(first: Iterator[Piece | Control] | None, after: list[Control]) -> Iterator[Piece | Control]:
    """``first`` and then ``after``, in order of u: motion may end within the cycle whose row is its last."""
    left = list(after)
    for piece in first or ():
        if isinstance(piece, Deactivation):
            while left and left[0].u < piece.u:
                yield left.pop(0)
        yield piece
    yield from left


class LinePlanner:
    """Plans the canonical lines of one program, one after the other.

    A line that flows becomes a segment of the planner's window; every other one starts and ends at rest, so
    the window is handed over first (``_flush``).
    """

    def __init__(
        self,
        machine: Machine,
        sink: MotionSink,
        positions: Mapping[int, float],
        energized: frozenset[int],
    ) -> None:
        self._machine = machine
        self._width = len(machine.axes)
        self._slots = {axis.index: column for column, axis in enumerate(machine.axes)}
        start = np.array([positions[axis.index] for axis in machine.axes])
        self._planner = MotionPlanner(machine, start)
        self._output = Output(sink)
        self._source: Iterator[Piece | Control] | None = None
        self._canonical: deque[Canonical | PlainRun | InPosition] = deque()
        self._energized = set(energized)
        self._ideal = frozenset(axis.index for axis in machine.axes if axis.drive.kind == "ideal")
        # axes that G1020 may still be moving
        self._independent: set[int] = set()
        # axes whose capture nobody has asked for the reading of yet; they stand
        self._captured: set[int] = set()
        self._unsettled: frozenset[int] = frozenset()
        self._observing = False
        self._from_rest = False
        self._tolerance = 0.0
        self._token = 0
        self._waiting_for: int | None = None
        self._reports: deque[Report] = deque()
        self._flush = False
        self._last_line = 0
        # where the next M00 or M01 stands on the time axis [cycles]
        self.pause_u: float | None = None

    def _put(self, piece: Piece | Control) -> None:
        if isinstance(piece, Rows | Control):
            self._output.put(piece)
        elif isinstance(piece, LineBound):
            bound = f"axis {self._machine.axes[piece.bound.column].index} {piece.bound.kind}"
            self._reports.append(Report(ReportKind.BOUND, piece.line, bound_by=bound))
        elif isinstance(piece, LineMark):
            kind = ControlKind.LINE_END if piece.ends else ControlKind.LINE_START
            self._output.put(Control(kind, piece.u, piece.line))
        elif isinstance(piece, Activation):
            self._output.put(Control(ControlKind.BEGIN, piece.u, piece.line, axes=piece.mask))
        else:
            self._output.put(
                Control(ControlKind.END, piece.u, piece.line, axes=piece.mask, values=piece.position)
            )

    def _settle(self, axes: frozenset[int]) -> None:
        """Asks the executor to bring axes to rest and to tell where they are (D-14, D-25)."""
        self._planner.to_whole_cycle()
        self._control(ControlKind.HALT_AXES, self._last_line, axes=self._mask(tuple(axes)))
        self._independent -= axes
        self._captured -= axes
        self._await_settled(axes, observing=True)

    def _await_settled(self, axes: frozenset[int], *, observing: bool) -> None:
        self._token += 1
        self._observing = observing
        self._unsettled = axes
        self._waiting_for = self._token
        self._control(ControlKind.SETTLE, self._last_line, axes=self._mask(tuple(axes)), token=self._token)
        self._output.flush()

    def _step(self) -> bool:
        """Plans the next canonical line; False where the window has to be handed over first."""
        line = self._canonical[0]
        if isinstance(line, PlainRun):
            self._canonical.popleft()
            if not self._flow_on(line):
                self._canonical.extendleft(reversed(line.motion_lines()))
            return True
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
        elif isinstance(line, InPosition):
            self._planner.to_whole_cycle()
            self._output.put(self._wait(line.line, line.axes))
            self._control(ControlKind.LINE_END, line.line)
        elif isinstance(line, AxisLine):
            self._axis_line(line)
        elif isinstance(line, PauseLine):
            self._planner.to_whole_cycle()
            self.pause_u = self._planner.u
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

    def _flow_on(self, run: PlainRun) -> bool:
        """Takes a run of plain lines into the window at once; False where they have to go one by one."""
        loose = not self._energized.issuperset(run.axes) or self._independent.intersection(run.axes)
        if loose or run.exact_stop or run.tolerance > 0.0:
            return False
        if not self._planner.append_run(run, from_rest=self._from_rest):
            return False
        for line, requested, travel in zip(
            run.lines.tolist(), run.requested.tolist(), run.travels.tolist(), strict=True
        ):
            self._reports.append(Report(ReportKind.PLANNED, line, requested_s=requested, feed_length=travel))
        self._tolerance = 0.0
        self._from_rest = False
        return True

    def _flow(self, line: MotionLine, group: FeedGroup) -> bool:
        """Takes the line as a segment of the window; False where it does not travel or its axes do not
        hold."""
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
            self._canonical.appendleft(InPosition(line.line, group.axes))
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
            # whole cycles are waited for; the rest of the dwell is a part of the time axis, so that what
            # follows is still sampled at the cycle
            cycles = math.floor(dwells[0] * self._machine.cycle_hz + CYCLE_ROUNDING)
            seconds = cycles * self._machine.cycle_s
            if cycles:
                after.append(Control(ControlKind.DWELL, planner.u, line.line, seconds=seconds))
            planner.rest(max(0.0, dwells[0] * self._machine.cycle_hz - cycles))
            end = planner.u
        if waits:
            planner.to_whole_cycle()
            end = planner.u
            after.append(self._wait(line.line, tuple(sorted(waits))))
            self._independent -= waits
        after.append(Control(ControlKind.LINE_END, end, line.line))
        self._source = then(self._source, after)

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
        if line.operation is not AxisOperation.CAPTURE:
            # the last setpoint reaches the drives before they are told to let go
            self._planner.rest(1.0)
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
            if self._captured:
                # asked for now, while everything rests: a later line that needs the reading need not
                # stop for it
                self._settle(frozenset(self._captured))
        else:
            self._captured -= set(line.axes)
            self._energized -= set(line.axes)

    def _ask_energized(self, line: MotionLine, axes: frozenset[int]) -> None:
        """Lets the executor judge axes that no capture of this program holds (D-27): it faults, or
        they hold."""
        self._control(ControlKind.BEGIN, line.line, axes=self._mask(tuple(axes)))
        self._canonical.appendleft(line)
        self._await_settled(axes, observing=False)

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
