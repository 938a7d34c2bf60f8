"""A program run by the server's own code on a virtual clock: what ``mcserver simulate`` and dry runs do."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mckinematics.pose import Kinematics
from mckinematics.solver import MachineKinematics

from mcserver.errors import Diagnostic
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.fault_codes import WARNINGS, remedy_of
from mcserver.executor.shm.feedback import AxisCondition
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.program_check import check_program
from mcserver.gcode.text.source import split_lines
from mcserver.machine.machine_file import Machine
from mcserver.planning.pipeline import Pipeline
from mcserver.planning.planner_messages import ReportKind
from mcserver.simulation.path_sampler import PathSampler
from mcserver.simulation.recorder import Recorded, Recorder
from mcserver.simulation.time_sampler import TimeSampler
from mcserver.simulation.tool_poses import ToolPoses
from mcserver.simulation.virtual_executor import VirtualExecutor
from mcserver.units import MM

# Cycles that the executor may take in one go between two looks at the planner.
BURST = 1000
# Cycles without any progress after which a run is given up [cycles]: exact stops time out long before.
STUCK = 600_000

SLOT = 0

_ENERGIZED = (
    AxisCondition.HOLDING,
    AxisCondition.MOVING,
    AxisCondition.SPEED,
    AxisCondition.TORQUE,
)


@dataclass(slots=True)
class LineRecord:
    """What is known of one line that took time."""

    line: int
    start: float = math.nan
    end: float = math.nan
    requested: float | None = None
    bound_by: str | None = None
    planning: float = 0.0
    # motions of the line that have begun, and those that ask for a time
    begun: int = 0
    timed: int = 0


@dataclass
class Simulation:
    """Result of a simulation.

    Attributes:
        report: the JSON object of interfaces.md.
        exit_code: 0, 1 (a fault while running) or 4 (rejected).
        recording: one row a cycle in mm and degrees, if asked for.
        feed_length: linear part of all G01-G03 commands [m].
        energized: numbers of the axes that are energized at the end.
    """

    report: dict[str, Any]
    exit_code: int
    recording: Recorded | None = None
    feed_length: float = 0.0
    energized: frozenset[int] = frozenset()


def simulate(
    text: str,
    machine: Machine,
    *,
    kinematics: Kinematics | None = None,
    progress: Callable[[float, int], None] | None = None,
    record: bool = False,
    path_points: int = 0,
    clock: Callable[[], float] = time.perf_counter,
    moments: TimeSampler | None = None,
) -> Simulation:
    """Checks the program, then runs it.

    Args:
        progress: called now and then with the simulated time [s] and the line that runs.
        record: keep a row a cycle.
        path_points: so many at most are in the report's ``path``; 0: it has none.
        clock: what ``planning_s`` is measured with [s].
        moments: keeps setpoints of all axes, evenly in time.

    Returns:
        The report; a program with faults is rejected as a whole and nothing of it is simulated.
    """
    faults = check_program(text, machine, kinematics)
    if any(fault.severity == "error" for fault in faults):
        return Simulation(_rejected(machine, faults), 4)
    sampler = None
    if path_points:
        solver = kinematics if isinstance(kinematics, MachineKinematics) else None
        sampler = PathSampler(machine, ToolPoses(machine, solver), path_points)
    found = _Run(text, machine, kinematics, progress, record, sampler, moments, clock).run(faults)
    if sampler is not None:
        found.report["path"] = sampler.path()
    return found


def _rejected(machine: Machine, faults: list[Diagnostic]) -> dict[str, Any]:
    return {
        "ok": False,
        "duration_s": 0.0,
        "feed_length_mm": 0.0,
        "lines": [],
        "axes": {
            str(axis.index): _axis_report(
                axis.type.unit, *([axis.initial_position / axis.type.si_per_unit] * 3)
            )
            for axis in machine.axes
        },
        "diagnostics": [fault.as_json() for fault in faults],
    }


def _axis_report(unit: str, position: float, low: float, high: float) -> dict[str, Any]:
    return {"position": position, "min": low, "max": high, "unit": unit}


class _Run:
    """One program on one virtual executor."""

    def __init__(
        self,
        text: str,
        machine: Machine,
        kinematics: Kinematics | None,
        progress: Callable[[float, int], None] | None,
        record: bool,
        sampler: PathSampler | None,
        moments: TimeSampler | None,
        clock: Callable[[], float],
    ) -> None:
        self._machine = machine
        self._input_names = [each.name for each in machine.inputs]
        self._lines = split_lines(text)
        self._progress = progress
        self._executor = VirtualExecutor(machine)
        mask = (1 << len(machine.axes)) - 1
        self._executor.open_slot(SLOT, mask)
        positions = {axis.index: axis.initial_position for axis in machine.axes}
        self._pipeline = Pipeline(
            machine, self._executor.sink(SLOT), positions=positions, kinematics=kinematics, clock=clock
        )
        self._pipeline.lines.put(1, self._lines)
        self._pipeline.lines.closed = True
        self._records: dict[int, LineRecord] = {}
        self._order: list[LineRecord] = []
        self._feed_length = 0.0
        self._end = 0.0
        self._finished = False
        self._faults: list[Diagnostic] = []
        row = self._executor.executor.row
        self._recorder = Recorder(machine, record, (row.inputs, row.outputs), sampler, moments)
        self._executor.recorder = self._recorder
        self._seen_u = -1.0
        # where the program's words read zero, by the name of the system
        self._zeros = Frame(systems=machine.dialect.systems).zeros()

    def run(self, warnings: list[Diagnostic]) -> Simulation:
        idle = 0
        while not self._finished and not self._failed:
            while self._pipeline.pump():
                continue
            self._take_reports()
            cycles = self._burst()
            self._executor.step(cycles)
            self._take_events()
            idle = 0 if self._moved() else idle + cycles
            if idle > STUCK:
                raise RuntimeError("the simulation makes no progress")
            if self._progress is not None:
                self._progress(self._executor.time, self._recorder.line)
        self._come_to_rest()
        return Simulation(
            self._report(warnings),
            1 if self._failed else 0,
            self._recorder.recording(),
            self._feed_length,
            self._energized(),
        )

    @property
    def _failed(self) -> bool:
        return any(fault.severity == "error" for fault in self._faults)

    # ------------------------------------------------------------------ the run

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

    def _take_reports(self) -> None:
        for report in self._pipeline.take_reports():
            if report.kind is ReportKind.PLANNED:
                self._plan(report.line, report.requested_s)
                self._feed_length += report.feed_length
            elif report.kind is ReportKind.SOLVED:
                self._record(report.line).planning = report.planning_s
            elif report.kind is ReportKind.BOUND:
                self._record(report.line).bound_by = report.bound_by
            elif report.kind is ReportKind.FRAME and report.frame is not None:
                self._zeros.update(report.frame.zeros())
            elif report.kind is ReportKind.REJECTED:
                self._faults += report.diagnostics

    def _plan(self, line: int, requested: float | None) -> None:
        """Add up the times that a line's motions ask for; a canned cycle has several."""
        if requested is not None:
            record = self._record(line)
            record.requested = requested + (record.requested or 0.0)
            record.timed += 1

    def _record(self, line: int) -> LineRecord:
        record = self._records.get(line)
        if record is None:
            record = self._records[line] = LineRecord(line)
            self._order.append(record)
        return record

    def _take_events(self) -> None:
        for event in self._executor.events():
            self._pipeline.on_event(event)
            self._take_event(event)

    def _take_event(self, event: ExecutorEvent) -> None:
        if event.kind is EventKind.LINE_START:
            record = self._record(event.line)
            # a line of several motions starts with the first of them
            record.start = event.time if record.begun == 0 else record.start
            record.begun += 1
        elif event.kind is EventKind.LINE_END:
            self._record(event.line).end = event.time
            self._end = max(self._end, event.time)
        elif event.kind is EventKind.FINISHED:
            self._finished = True
            self._end = max(self._end, event.time)
        elif event.kind is EventKind.PAUSED:
            self._executor.mailbox.resume(SLOT)
        elif event.kind is EventKind.FAULT:
            message, hint = remedy_of(event.code, event.axis, event.values, self._input_names)
            self._faults.append(
                Diagnostic(
                    code=f"MC{event.code}",
                    severity="warning" if event.code in WARNINGS else "error",
                    message=message,
                    line=event.line,
                    column=1,
                    end_column=1 + max(1, len(self._text_of(event.line))),
                    hint=hint,
                    axis=event.axis if event.axis >= 0 else None,
                )
            )

    def _text_of(self, line: int) -> str:
        return self._lines[line - 1] if 0 < line <= len(self._lines) else ""

    def _come_to_rest(self) -> None:
        """Runs on until every positioned axis is at rest (G1020 too); G1030 and G1040 axes do not hold
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

    def _energized(self) -> frozenset[int]:
        conditions = self._executor.feedback.condition
        return frozenset(
            axis.index
            for axis, condition in zip(self._machine.axes, conditions, strict=True)
            if condition in _ENERGIZED
        )

    def _report(self, warnings: list[Diagnostic]) -> dict[str, Any]:
        lines = []
        self._order.sort(key=lambda each: (each.start, each.line))
        for record in self._order:
            if not record.end > record.start:
                continue
            actual = record.end - record.start
            asked = record.requested if record.timed >= record.begun else None
            stretched = actual / asked if asked else None
            line = {
                "line": record.line,
                "start_s": record.start,
                "end_s": record.end,
                "requested_s": asked,
                "stretched_by": stretched,
                "bound_by": record.bound_by,
            }
            if self._machine.tools:
                line["planning_s"] = record.planning
            lines.append(line)
        machine = self._machine
        axes = {}
        low, high, last = self._recorder.low, self._recorder.high, self._recorder.last
        for column, axis in enumerate(self._machine.axes):
            unit = axis.type.si_per_unit
            axes[str(axis.index)] = _axis_report(
                axis.type.unit,
                *(float(each[column]) / unit for each in (last, low, high)),
            )
        report = {
            "ok": not self._failed,
            "duration_s": self._end,
            "feed_length_mm": self._feed_length / MM,
            "lines": lines,
            "axes": axes,
            "diagnostics": [each.as_json() for each in (*warnings, *self._faults)],
        }
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

    def _work_offsets(self) -> list[dict[str, Any]]:
        """Return where each system that the program used or set reads zero [mm, deg]."""
        scale = {axis.index: axis.type.si_per_unit for axis in self._machine.axes}
        return [
            {"system": name, "origin": {str(axis): at / scale[axis] for axis, at in sorted(origin.items())}}
            for name, origin in self._zeros.items()
        ]
