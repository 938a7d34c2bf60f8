"""Judge an answer by checking and simulating it with the server's own code."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping

import numpy as np
from mckinematics.errors import KinematicsError
from mckinematics.solver import MachineKinematics

from mcbenchmark.answers import program_in
from mcbenchmark.motion_record import MotionRecord, axis_number
from mcbenchmark.path_check import PathMismatch, enters, follow
from mcbenchmark.rest_check import stray_motion
from mcbenchmark.tasks import Expectation, Range, Task
from mcbenchmark.verdict import Check, Finding, Verdict
from mcserver.errors import McError, Refused
from mcserver.gcode.line_faults import FaultList
from mcserver.gcode.text.scanner import scan
from mcserver.gcode.text.source import split_lines
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.assertions import Assertion, AssertionMeter, check_assertions
from mcserver.simulation.simulation import Simulation, simulate
from mcserver.simulation.starting_machine import starting_at

MAX_ANSWER = 64 * 1024  # characters
MAX_LINES = 2000
# Two programs move the axes alike that differ by no more [mm or deg, cycles].
ALIKE, ALIKE_CYCLES = 0.01, 5
ON_FACE = 1e-3  # the faces of a zone belong to it [mm]
_CHECKS = {
    "end": Check.END,
    "position": Check.ZONE,
    "duration": Check.DURATION,
    "clearance": Check.ZONE,
}


class _Endless(Exception):
    """The simulated time is over."""


@functools.lru_cache(maxsize=16)
def _machine(source: str) -> tuple[Machine, MachineKinematics | None]:
    machine = load_machine(source)
    return machine, build_kinematics(machine)


def judge(task: Task, text: str) -> Verdict:
    """Check and simulate an answer's program, and compare what it does with what the task expects.

    Raises:
        ConfigurationError: the task's machine cannot be loaded.
    """
    return Verdict(task.id, task.category, tuple(_findings(task, program_in(text))))


def _findings(task: Task, text: str) -> Iterator[Finding]:
    if not text.strip():
        yield Finding(Check.ANSWER, "there is no program")
        return
    if len(text) > MAX_ANSWER or len(split_lines(text)) > MAX_LINES:
        yield Finding(Check.ANSWER, f"the program has more than {MAX_ANSWER} characters or {MAX_LINES} lines")
        return
    machine, kinematics = _machine(task.machine)
    if task.start:
        machine = _started(machine, task.start)

    def stop_in_time(time_s: float, _line: int) -> None:
        if time_s > task.limit_s:
            raise _Endless

    try:
        run = simulate(text, machine, kinematics=kinematics, progress=stop_in_time, record=True)
    except _Endless:
        yield Finding(Check.ENDLESS, f"it runs for more than {task.limit_s:g} s")
        return
    except (McError, KinematicsError) as error:
        yield Finding(Check.FAULT, str(error))
        return
    faults = [each for each in run.report["diagnostics"] if each["severity"] == "error"]
    if faults or run.recording is None:
        check = Check.REJECTED if run.exit_code == 4 else Check.FAULT
        for fault in faults[:3]:
            yield Finding(check, f"{fault['code']} in line {fault['line']}: {fault['message']}")
        return
    yield from _codes(task.expect, text)
    try:
        yield from _compare(task.expect, MotionRecord(run.recording, machine, kinematics))
        yield from _asserted(task.expect, run, machine, kinematics)
    except Refused as error:
        yield Finding(Check.PATH, error.message)
    yield from _powered(task.expect, run)


def same_motion(task: Task, text: str, other: str) -> bool:
    """Return True if two programs move the axes alike: no judge of motion can tell one from the other."""
    machine, kinematics = _machine(task.machine)
    if task.start:
        machine = _started(machine, task.start)
    runs = [simulate(each, machine, kinematics=kinematics, record=True).recording for each in (text, other)]
    if any(run is None for run in runs):
        return False
    paths = [run.setpoint for run in runs if run is not None]
    least = min(map(len, paths))
    alike = max(map(len, paths)) - least <= ALIKE_CYCLES
    return alike and bool(np.abs(paths[0][:least] - paths[1][:least]).max(initial=0.0) <= ALIKE)


def _started(machine: Machine, start: Mapping[str, float]) -> Machine:
    """Return the machine with its axes elsewhere [mm or deg]."""
    scale = {axis.index: axis.type.si_per_unit for axis in machine.axes}
    places = {axis_number(name): value for name, value in start.items()}
    return starting_at(machine, {axis: value * scale.get(axis, 1.0) for axis, value in places.items()})


def _compare(expect: Expectation, record: MotionRecord) -> Iterator[Finding]:
    try:
        followed = follow(record, expect.path, expect.speed)
        for stray in stray_motion(record, expect, followed):
            yield Finding(Check.STRAY, stray)
    except PathMismatch as error:
        yield Finding(Check.PATH, str(error))
    for name, allowed in expect.speeds.items():
        speed = record.final_speed(name)
        if _outside(speed, allowed):
            yield Finding(Check.AXES, f"axis {name} ends at {speed:.6g} per second, not {_shown(allowed)}")
    for box in expect.avoid:
        when = enters(record, box)
        if when is not None:
            yield Finding(Check.ZONE, f"the forbidden zone is entered at {when:.3f} s")


def assertions_of(expect: Expectation) -> list[Assertion]:
    """Return what of an expectation `mcserver simulate --assert` judges too."""
    found = [
        Assertion("end", name, value - expect.tolerance, value + expect.tolerance)
        for name, value in expect.end.items()
    ]
    found += [
        Assertion("position", name, low - ON_FACE, high + ON_FACE)
        for name, (low, high) in expect.within.items()
    ]
    if expect.duration_s is not None:
        found.append(Assertion("duration", "", *expect.duration_s))
    if expect.clear_mm is not None:
        found.append(Assertion("clearance", "", expect.clear_mm))
    return found


def _asserted(
    expect: Expectation, run: Simulation, machine: Machine, kinematics: MachineKinematics | None
) -> Iterator[Finding]:
    asked, recorded = assertions_of(expect), run.recording
    check_assertions(asked, machine, kinematics)
    meter = AssertionMeter(asked, machine, kinematics)
    assert recorded is not None
    scale = [axis.type.si_per_unit for axis in machine.axes]
    meter.take(recorded.time_s, recorded.line.astype(int), recorded.setpoint * scale)
    judged = [each for each in meter.judge(run.report) if not each.holds]
    for each, fault in zip(judged, meter.faults(judged), strict=True):
        yield Finding(_CHECKS[each.what], fault.message)


def _powered(expect: Expectation, run: Simulation) -> Iterator[Finding]:
    for axes, wanted in ((expect.energized, True), (expect.released, False)):
        wrong = [axis for axis in axes if (axis in run.energized) is not wanted]
        if wrong:
            state = "not energized" if wanted else "still energized"
            yield Finding(Check.AXES, f"axes {', '.join(map(str, wrong))} are {state} at the end")


def _codes(expect: Expectation, text: str) -> Iterator[Finding]:
    lines = codes_of(text)
    used = frozenset[str]().union(*lines)
    for alternatives in expect.uses:
        if not used & set(alternatives.split("|")):
            yield Finding(Check.CODES, f"{' or '.join(alternatives.split('|'))} does not occur")
    for code in expect.lacks:
        if code in used:
            yield Finding(Check.CODES, f"{code} occurs")
    count = sum(map(bool, lines))
    if expect.max_lines is not None and count > expect.max_lines:
        yield Finding(Check.CODES, f"there are {count} lines of code, {expect.max_lines} are allowed")


def codes_of(text: str) -> list[frozenset[str]]:
    """Return the words of each line of code: codes as ``G01``, tools as ``T3``, other letters alone."""
    found = []
    for number, line in enumerate(split_lines(text), 1):
        words = set()
        tokens = [] if line.lstrip().startswith("%") else scan(line, FaultList(number)).tokens
        for name, digits, _ in tokens:
            if name in ("G", "M", "T") and digits.isdigit():
                words.add(f"{name}{int(digits[:12]):0{1 if name == 'T' else 2}d}")
            elif digits:
                words.add(name)
        found.append(frozenset(words))
    return found


def _outside(value: float, allowed: Range | None) -> bool:
    return allowed is not None and not allowed[0] <= value <= allowed[1]


def _shown(allowed: Range | None) -> str:
    return "" if allowed is None else f"{allowed[0]:g} to {allowed[1]:g}"
