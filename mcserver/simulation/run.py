"""One program on one virtual executor: fed, planned, played and reported."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, TypedDict

import msgspec
import numpy as np
from mckinematics.pose import Kinematics
from mckinematics.solver import MachineKinematics
from numpy.typing import NDArray

from mcserver.clearance.meter import ClearanceMeter
from mcserver.drives.bus import DriveMode
from mcserver.errors import Diagnostic
from mcserver.executor.block import LineEvents
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.fault_codes import WARNINGS, FaultCode, remedy_of
from mcserver.executor.shm.feedback import AxisCondition, homed_of
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.text.source import LineSource
from mcserver.machine.clearance_section import GivenBody
from mcserver.machine.machine_file import Machine
from mcserver.machine.work_systems import ANGLE
from mcserver.planning.clearance_guard import ClearanceGuard, ClearanceGuards
from mcserver.planning.exchanges import mounted_by
from mcserver.planning.line_marks import LineMarks
from mcserver.planning.pipeline import Pipeline
from mcserver.planning.planner_messages import PlannedLines, ReportKind
from mcserver.planning.shared_space import SharedSpace
from mcserver.planning.start_state import PauseEnd, StartState
from mcserver.simulation.assertions import Assertion, AssertionMeter
from mcserver.simulation.line_times import LineTimes
from mcserver.simulation.lost_drives import LostDrives
from mcserver.simulation.path_sampler import PathSampler
from mcserver.simulation.recorder import CycleTaker, Recorded, Recorder
from mcserver.simulation.virtual_executor import VirtualExecutor
from mcserver.units import DEGREE, MM

# Cycles that the executor may take in one go between two looks at the planner.
BURST = 1000
# Cycles without any progress after which a run is given up [cycles]: exact stops time out long before.
STUCK = 600_000
# Cycles without motion, and time after the last change of an input [s], from which on an input holds the
# program for good: longer than any debouncing.
HELD, HELD_S = 1000, 60.0
# Time that G1060 may wait for a piece while its leader stands, or after the last change of an input [s].
PATIENCE_S = 10.0
# Lines that wait to be planned: more than one piece of the planner's work reads.
AHEAD_LINES = 20_000

SLOT = 0

_ENERGIZED = (
    AxisCondition.HOLDING,
    AxisCondition.MOVING,
    AxisCondition.SPEED,
    AxisCondition.TORQUE,
)


@dataclass
class Simulation:
    """Result of a simulation.

    Attributes:
        report: what ``mcserver simulate --json`` prints; `simulate_lines` leaves its ``lines`` empty.
        times: of its lines. last_line: how many there are.
        exit_code: 0, 1 (a fault while running) or 4 (rejected).
        recording: one row a cycle in mm and degrees, if asked for.
        energized: numbers of the axes that are energized at the end.
        end: the state that it leaves behind; None: nothing was run.
        inputs_read: columns of inputs that it reads.
        failed: it ended in a fault of the run itself, whatever its assertions come to.
        turned: axes that it commands a speed, each with the greatest [m/s or rad/s]. pushed: axes that it
            commands a torque.
        outputs: of each output the least and the greatest value. bodies: that it brings.
    """

    report: dict[str, Any]
    exit_code: int
    recording: Recorded | None = None
    energized: frozenset[int] = frozenset()
    end: StartState | None = None
    inputs_read: frozenset[int] = frozenset()
    failed: bool = False
    turned: Mapping[int, float] = field(default_factory=dict)
    pushed: frozenset[int] = frozenset()
    outputs: tuple[tuple[float, float], ...] = ()
    bodies: tuple[GivenBody, ...] = ()
    times: LineTimes = field(default_factory=LineTimes)
    last_line: int = 0

    def marks(self) -> LineMarks:
        """Return when its lines end, in as many marks as it takes."""
        return self.times.all_marks(self.report["duration_s"], self.last_line)


class Conditions(TypedDict, total=False):
    """What a program is simulated under, and what is kept of it.

    Attributes:
        start: all that it starts from besides text and machine; None: a machine that nobody has used.
        lease: axes that it may use; None: all.
        progress: called now and then with the simulated time [s] and the line that runs.
        record: keep a row a cycle.
        path_points: so many at most are in the report's ``path``; 0: it has none.
        clock: what ``planning_s`` is measured with [s].
        takers: are shown the setpoints of every cycle.
        assertions: are judged; one that does not hold is a fault (MC330).
        against: another program's text: the report has the ``difference`` to its motion from the same start.
        stops: of a machine with bodies or zones, judge as the server does while it runs, wherever holds,
            overrides, aborts and emergency stops may bring axes.
        role: whose run it is: zones of others do not bind it; None: whoever's, so that all zones count.
    """

    start: StartState | None
    lease: frozenset[int] | None
    kinematics: Kinematics | None
    progress: Callable[[float, int], None] | None
    record: bool
    path_points: int
    clock: Callable[[], float]
    takers: Sequence[CycleTaker]
    assertions: Sequence[Assertion]
    against: str | None
    stops: bool
    role: str | None


def solver_of(given: Conditions) -> MachineKinematics | None:
    """Return what solves a machine's tools; None: none of them moves."""
    kinematics = given.get("kinematics")
    return kinematics if isinstance(kinematics, MachineKinematics) else None


def axis_report(unit: str, position: float, low: float, high: float) -> dict[str, Any]:
    return {"position": position, "min": low, "max": high, "unit": unit}


class Run:
    """One program, which has been checked, on one virtual executor."""

    def __init__(
        self,
        source: LineSource,
        machine: Machine,
        given: Conditions,
        sampler: PathSampler | None,
        times: LineTimes,
    ) -> None:
        start = given["start"] or StartState.of(machine)
        self._machine = machine
        self._input_names = [each.name for each in machine.inputs]
        self._source = source
        self._coming = source()
        self._read = 0
        self._times = times
        self._progress = given.get("progress")
        self._stops = given.get("stops", False)
        self._role = given.get("role")
        self._executor = VirtualExecutor(machine)
        self._executor.bring_to(start)
        mask = (1 << len(machine.axes)) - 1
        self._executor.open_slot(SLOT, mask)
        self._guard = self._guarded(start, given.get("lease")) if self._stops else None
        self._pipeline = Pipeline(
            machine,
            self._executor.sink(SLOT),
            start=start,
            lease=given.get("lease"),
            kinematics=given.get("kinematics"),
            clock=given.get("clock", time.perf_counter),
            guard=self._guard,
        )
        self._feed_length = 0.0
        # lines that have been planned and not passed, with the lengths of their feed moves [m]
        self._planned: deque[tuple[NDArray[np.int64], NDArray[np.float64]]] = deque()
        # every line through this one has been run
        self._passed = 0
        self._end = 0.0
        self._finished = False
        self._faults: list[Diagnostic] = []
        row = self._executor.executor.row
        self._clearance: ClearanceMeter | None = None
        if machine.clearance is not None:
            positions = np.array([axis.initial_position for axis in machine.axes])
            self._clearance = ClearanceMeter(machine, positions, mounted_by(machine, start.frame), self._role)
        self._assertions = AssertionMeter(given.get("assertions", ()), machine, solver_of(given))
        channels, keep = (row.inputs, row.outputs), given.get("record", False)
        self._lost = self._lost_drives(start) if self._stops else None
        assertions = self._assertions if given.get("assertions") else None
        more = (assertions, self._lost, self._clearance)
        takers = [each for each in (sampler, *given.get("takers", ()), *more) if each is not None]
        self._recorder = Recorder(machine, keep, channels, takers)
        self._executor.recorder = self._recorder
        self._seen_u = -1.0
        # of the axes, as the program last went on
        self._places = row.actual.copy()
        self._last_input_s = max((each.at_s for one in machine.inputs for each in one.script), default=0.0)
        # where the program's words read zero, by the name of the system
        self._frame = start.frame
        self._inputs_read: set[int] = set()
        # columns of inputs that hold the program
        self._holding: set[int] = set()
        self._zeros = (start.frame or Frame()).zeros()

    def run(self, warnings: list[Diagnostic]) -> Simulation:
        idle = 0
        while not self._finished and not self._failed:
            self._feed()
            while self._pipeline.pump():
                self._feed()
            self._take_reports()
            cycles = self._burst()
            self._executor.step(cycles)
            self._take_events()
            idle = 0 if self._moved() else idle + cycles
            if idle == 0:
                self._places[:] = self._executor.executor.row.actual
            elif self._holding:
                if idle > HELD and self._executor.time > self._last_input_s + HELD_S:
                    self._give_up_held()
            elif idle > STUCK or self._waits_in_vain(idle):
                self._give_up(
                    "MC333",
                    "the program waits for something that does not come in this simulation",
                    "let inputs come (--input NAME=on@SECONDS), and let the program move what G1060 follows",
                )
            if self._progress is not None:
                self._progress(self._executor.time, self._recorder.line)
        self._come_to_rest()
        if not self._finished:
            self._feed_length = max(0.0, self._feed_length - self._not_run())
        # before a contact motion ends as near as the margin: the meter would tell of it once more
        if self._clearance is not None and not (self._stops and self._failed):
            self._faults += self._clearance.contacts()
        self._faults += self._held_alone()
        if self._lost is not None and not self._failed:
            self._lost.finish()
            self._faults += self._lost.findings()
        report = self._report(warnings)
        return Simulation(
            report,
            0 if report["ok"] else 1,
            self._recorder.recording(),
            self._with_condition(_ENERGIZED),
            self._end_state(),
            frozenset(self._inputs_read),
            self._failed,
            self._turned(),
            self._powered(DriveMode.TORQUE),
            tuple(
                zip(self._recorder.outputs_low.tolist(), self._recorder.outputs_high.tolist(), strict=True)
            ),
            () if self._clearance is None else self._clearance.brought,
            self._times,
            self._read,
        )

    @property
    def _failed(self) -> bool:
        return any(fault.severity == "error" for fault in self._faults)

    # ------------------------------------------------------------------ the run

    def _guarded(self, start: StartState, lease: frozenset[int] | None) -> ClearanceGuard:
        """Return what the server judges its programs by."""
        machine, executor = self._machine, self._executor
        axes = frozenset(axis.index for axis in machine.axes) if lease is None else lease
        guards = ClearanceGuards(machine, SharedSpace(machine, lambda: executor.feedback))
        return guards.guard("the program", SLOT, axes, mounted_by(machine, start.frame), role=self._role)

    def _lost_drives(self, start: StartState) -> LostDrives:
        """Return what judges where a drive that is lost brings its axis."""
        machine, motions = self._machine, self._executor.executor.motions
        positions = np.array([axis.initial_position for axis in machine.axes])
        mounted = mounted_by(machine, start.frame)
        return LostDrives(machine, positions, lambda: (motions.mask, motions.speeding), mounted, self._role)

    def _give_up_held(self) -> None:
        names = ", ".join(f'"{self._input_names[column]}"' for column in sorted(self._holding))
        self._give_up(
            f"MC{int(FaultCode.INTERLOCK_HOLD)}",
            f"the program is held for good by: {names}",
            "let the input become what it should be, such as --input NAME=off@2.5",
        )

    def _give_up(self, code: str, message: str, hint: str) -> None:
        """Abort the program at the line under way: nothing will let it go on."""
        self._faults.append(self._fault(code, self._passed + 1, message, hint))
        self._executor.mailbox.abort(SLOT)

    def _fault(
        self, code: str, line: int, message: str, hint: str, *, warning: bool = False, axis: int | None = None
    ) -> Diagnostic:
        """Return a diagnostic that marks a whole line."""
        return Diagnostic(
            code=code,
            severity="warning" if warning else "error",
            message=message,
            line=line,
            column=1,
            end_column=1 + max(1, len(self._text_of(line))),
            hint=hint,
            axis=axis,
        )

    def _held_alone(self) -> list[Diagnostic]:
        """Return before which switched zones stops may hold the program, where its setpoints stay out."""
        found = [] if self._guard is None else [*self._guard.held.values()]
        known = {each.line for each in self._faults}
        return [
            msgspec.structs.replace(each, column=1, end_column=2) for each in found if each.line not in known
        ]

    def _feed(self) -> None:
        """Give the planner lines, more than it reads in one go: a window that runs dry ends in a stop."""
        lines = self._pipeline.lines
        if not lines.closed and len(lines) < AHEAD_LINES // 2:
            more = list(islice(self._coming, AHEAD_LINES))
            lines.put(self._read + 1, more)
            self._read += len(more)
            lines.closed = len(more) < AHEAD_LINES

    def _burst(self) -> int:
        """Cycles up to which nothing can run dry: motion that is handed over is played before the next
        look."""
        if self._pipeline.waiting:
            return 1
        ahead = self._pipeline.playable_u
        if self._pipeline.pause_u is not None:
            # a pause is answered in the cycle in which it is reported
            ahead = min(ahead, self._pipeline.pause_u)
        return max(1, min(BURST, int(ahead - self._u())))

    def _u(self) -> float:
        return self._executor.u(SLOT)

    def _moved(self) -> bool:
        moved = self._u() != self._seen_u or self._executor.executor.timed
        self._seen_u = self._u()
        return moved

    def _waits_in_vain(self, idle: int) -> bool:
        """Return whether G1060 waits for a work that comes no more, or whose leader stands (D-142)."""
        cycle_s, now = self._machine.cycle_s, self._executor.time
        if min(idle * cycle_s, now - self._last_input_s) <= PATIENCE_S:
            return False
        ways = np.abs(self._executor.executor.row.actual - self._places)
        return any(
            each.waits and (each.lacks_work or ways[each.leader.column] <= each.tolerance)
            for each in self._executor.executor.couplings
        )

    def _take_reports(self) -> None:
        for report in self._pipeline.take_reports_in_columns():
            if isinstance(report, PlannedLines):
                self._times.asked_in_columns(report.lines, report.requested_s)
                self._feed_length = math.fsum((self._feed_length, *report.feed_lengths.tolist()))
                self._planned.append((report.lines, report.feed_lengths))
            elif report.kind is ReportKind.PLANNED:
                if report.requested_s is not None:
                    self._times.asked(report.line, report.requested_s)
                if report.dwell_s:
                    self._times.dwelt(report.line, report.dwell_s)
                self._feed_length += report.feed_length
                if report.feed_length:
                    self._planned.append((np.array([report.line]), np.array([report.feed_length])))
            elif report.kind is ReportKind.CONTACT:
                # said again while the motion comes to rest
                if not self._failed:
                    contact = report.diagnostics[0]
                    self._faults.append(msgspec.structs.replace(contact, column=1, end_column=2))
                self._end = max(self._end, self._executor.time)
                # as the service does; it stands on its path already
                self._executor.mailbox.abort(SLOT)
            elif report.exchange is not None and self._clearance is not None:
                self._clearance.exchange(report.exchange)
                if self._lost is not None:
                    self._lost.exchange(report.exchange)
            elif report.kind is ReportKind.SOLVED:
                self._times.solved(report.line, report.planning_s)
            elif report.kind is ReportKind.BOUND:
                self._times.bound(report.line, report.bound_by)
            elif report.kind is ReportKind.FRAME and report.frame is not None:
                self._frame = report.frame
                self._zeros.update(report.frame.zeros())
            elif report.kind is ReportKind.REJECTED:
                self._faults += report.diagnostics

    def _take_events(self) -> None:
        while self._planned and self._planned[0][0][-1] <= self._passed:
            self._planned.popleft()
        for event in self._executor.reports():
            if isinstance(event, LineEvents):
                self._times.passed(event.line, event.time, event.ends)
                self._end = max(self._end, float(event.time[event.ends].max(initial=0.0)))
                self._passed = max(self._passed, int(event.line[~event.ends].max(initial=0)) - 1)
                continue
            self._pipeline.on_event(event)
            self._take_event(event)

    def _take_event(self, event: ExecutorEvent) -> None:
        if event.kind is EventKind.LINE_START:
            self._times.started(event.line, event.time)
            self._passed = max(self._passed, event.line - 1)
        elif event.kind is EventKind.LINE_END:
            self._times.ended(event.line, event.time)
            self._end = max(self._end, event.time)
        elif event.kind is EventKind.PASSED:
            self._passed = max(self._passed, event.line)
        elif event.kind is EventKind.STOPPED:
            self._end = max(self._end, event.time)
        elif event.kind is EventKind.INPUT:
            self._inputs_read.add(event.token)
        elif event.kind is EventKind.FINISHED:
            self._finished = True
            self._end = max(self._end, event.time)
        elif event.kind is EventKind.PAUSED:
            self._times.paused(event.line)
            self._executor.mailbox.end_pause(SLOT)
            self._pipeline.end_pause(PauseEnd())
        elif event.kind is EventKind.FAULT:
            if event.code == FaultCode.INTERLOCK_HOLD:
                self._holding.add(int(event.values[0]))
            elif event.code == FaultCode.INTERLOCK_FREE:
                self._holding.discard(int(event.values[0]))
                if not self._holding:
                    # as behind a pause
                    self._executor.mailbox.resume(SLOT)
            if event.code not in WARNINGS:
                self._end = max(self._end, event.time)
                self._passed = min(self._passed, event.line - 1) if event.line else self._passed
            message, hint = remedy_of(event.code, event.axis, event.values, self._input_names)
            axis, warning = event.axis if event.axis >= 0 else None, event.code in WARNINGS
            self._faults.append(
                self._fault(f"MC{event.code}", event.line, message, hint, warning=warning, axis=axis)
            )

    def _not_run(self) -> float:
        """Return the length at feed of planned lines that a fault kept from being run to their ends [m]."""
        return math.fsum(float(lengths[lines > self._passed].sum()) for lines, lengths in self._planned)

    def _text_of(self, line: int) -> str:
        return next(islice(self._source(), line - 1, None), "") if line > 0 else ""

    def _come_to_rest(self) -> None:
        """Run on until every positioned axis is at rest (G1020 too); G1030 and G1040 axes do not hold
        the run."""
        moving = False
        for _ in range(STUCK):
            if self._executor.at_rest:
                break
            moving = True
            self._executor.step(1)
            self._take_events()
        if moving:
            self._end = max(self._end, self._executor.time)

    def _end_state(self) -> StartState:
        executor, axes = self._executor.executor, self._machine.axes
        row, shaper = executor.row, executor.bank.shaper
        turning = self._with_condition((AxisCondition.SPEED,)) & self._axes_of(executor.motions.turning())
        return StartState(
            positions=dict(zip((axis.index for axis in axes), row.setpoint.tolist(), strict=True)),
            energized=self._with_condition(_ENERGIZED),
            unsettled=turning | self._with_condition((AxisCondition.TORQUE,)),
            homed=self._axes_of(homed_of(row.row)),
            frame=self._frame,
            inputs=tuple(row.inputs.tolist()),
            outputs=tuple(row.outputs.tolist()),
            tool=0 if shaper is None else shaper.tool,
        )

    def _turned(self) -> dict[int, float]:
        greatest = self._executor.executor.motions.greatest_speeds
        return {axis: greatest[self._machine.column_of(axis)] for axis in self._powered(DriveMode.VELOCITY)}

    def _powered(self, mode: DriveMode) -> frozenset[int]:
        """Return the axes that were powered in a mode."""
        return self._axes_of(self._executor.executor.bank.used[mode])

    def _axes_of(self, mask: int) -> frozenset[int]:
        return frozenset(axis.index for column, axis in enumerate(self._machine.axes) if mask >> column & 1)

    def _with_condition(self, wanted: Collection[AxisCondition]) -> frozenset[int]:
        """Return the axes in one of these conditions."""
        conditions = self._executor.feedback.condition
        return frozenset(
            axis.index
            for axis, condition in zip(self._machine.axes, conditions, strict=True)
            if condition in wanted
        )

    def _report(self, warnings: list[Diagnostic]) -> dict[str, Any]:
        machine = self._machine
        axes = {}
        low, high, last = self._recorder.low, self._recorder.high, self._recorder.last
        for column, axis in enumerate(self._machine.axes):
            unit = axis.type.si_per_unit
            axes[str(axis.index)] = axis_report(
                axis.type.unit,
                *(float(each[column]) / unit for each in (last, low, high)),
            )
        report = {
            "ok": not self._failed,
            "duration_s": self._end,
            "feed_length_mm": self._feed_length / MM,
            "lines": [],
            "axes": axes,
            "diagnostics": [each.as_json() for each in (*warnings, *self._faults)],
        }
        if machine.shaping is not None and machine.shaping.length:
            report["shaping"] = {
                "delay_s": machine.shaping.delay * machine.cycle_s,
                "length_s": machine.shaping.length * machine.cycle_s,
                "path_deviation_mm": machine.shaping.path_deviation / MM,
                "path_tolerance_mm": machine.path_tolerance / MM,
            }
        if self._clearance is not None:
            judged: dict[str, Any] = {} if self._lost is None else {"stops": True}
            if self._lost is not None and not self._failed:
                judged["lost_drives"] = self._lost.report()
            report["clearance"] = {**self._clearance.report(), **judged}
        self._judge(report)
        offsets = self._work_offsets()
        if offsets:
            report["work_offsets"] = offsets
        row = self._executor.executor.row
        if machine.inputs:
            report["inputs"] = {
                each.name: float(value) for each, value in zip(machine.inputs, row.inputs, strict=True)
            }
        if machine.outputs:
            report["outputs"] = {
                each.name: float(value) for each, value in zip(machine.outputs, row.outputs, strict=True)
            }
        return report

    def _judge(self, report: dict[str, Any]) -> None:
        """Add what the assertions come to, and a fault for each that does not hold."""
        judged = self._assertions.judge({**report, "last_line": self._recorder.line})
        if judged:
            faults = self._assertions.faults(judged)
            report["assertions"] = [msgspec.to_builtins(each) for each in judged]
            report["diagnostics"] += [each.as_json() for each in faults]
            report["ok"] = report["ok"] and not faults

    def _work_offsets(self) -> list[dict[str, Any]]:
        """Return where each system that the program used or set reads zero [mm, deg]."""
        scale = {axis.index: axis.type.si_per_unit for axis in self._machine.axes}
        return [
            {
                "system": name,
                "origin": {
                    str(axis): at / scale[axis] for axis, at in sorted(origin.items()) if axis in scale
                },
                "rotation": origin.get(ANGLE, 0.0) / DEGREE,
            }
            for name, origin in self._zeros.items()
        ]
