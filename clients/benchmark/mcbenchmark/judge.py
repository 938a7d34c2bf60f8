"""Judge an answer by checking and simulating it with the server's own code."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping

from mckinematics.errors import KinematicsError
from mckinematics.solver import MachineKinematics

from mcbenchmark.motion_record import MotionRecord, UnknownCoordinate, axis_number
from mcbenchmark.path_check import PathMismatch, enters, follow, leaves
from mcbenchmark.tasks import Expectation, Range, Task
from mcbenchmark.verdict import Check, Finding, Verdict
from mcserver.errors import McError
from mcserver.gcode.line_faults import FaultList
from mcserver.gcode.text.scanner import scan
from mcserver.gcode.text.source import split_lines
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import Simulation, simulate
from mcserver.simulation.starting_machine import starting_at

MAX_ANSWER = 64 * 1024  # characters
MAX_LINES = 2000


class _Endless(Exception):
    """The simulated time is over."""


@functools.lru_cache(maxsize=16)
def _machine(source: str) -> tuple[Machine, MachineKinematics | None]:
    machine = load_machine(source)
    return machine, build_kinematics(machine)


def judge(task: Task, text: str) -> Verdict:
    """Check and simulate a program, and compare what it does with what the task expects.

    Raises:
        ConfigurationError: the task's machine cannot be loaded.
    """
    return Verdict(task.id, task.category, tuple(_findings(task, text)))


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
    yield from _compare(task.expect, text, run, MotionRecord(run.recording, machine, kinematics))


def _started(machine: Machine, start: Mapping[str, float]) -> Machine:
    """Return the machine with its axes elsewhere [mm or deg]."""
    scale = {axis.index: axis.type.si_per_unit for axis in machine.axes}
    places = {axis_number(name): value for name, value in start.items()}
    return starting_at(machine, {axis: value * scale.get(axis, 1.0) for axis, value in places.items()})


def _compare(expect: Expectation, text: str, run: Simulation, record: MotionRecord) -> Iterator[Finding]:
    yield from _codes(expect, text)
    try:
        try:
            follow(record, expect.path)
        except PathMismatch as error:
            yield Finding(Check.PATH, str(error))
        yield from _places(expect, record)
    except UnknownCoordinate as error:
        yield Finding(Check.PATH, str(error))
    duration = run.report["duration_s"]
    if _outside(duration, expect.duration_s):
        yield Finding(Check.DURATION, f"the run takes {duration:.6g} s, not {_shown(expect.duration_s)} s")
    for axes, wanted in ((expect.energized, True), (expect.released, False)):
        wrong = [axis for axis in axes if (axis in run.energized) is not wanted]
        if wrong:
            state = "not energized" if wanted else "still energized"
            yield Finding(Check.AXES, f"axes {', '.join(map(str, wrong))} are {state} at the end")


def _places(expect: Expectation, record: MotionRecord) -> Iterator[Finding]:
    for name, value in expect.end.items():
        end = float(record.path([name])[-1, 0])
        if abs(end - value) > expect.tolerance:
            yield Finding(Check.END, f"{name} ends at {end:.6g}, not at {value:g}")
    for name, allowed in expect.speeds.items():
        speed = record.final_speed(name)
        if _outside(speed, allowed):
            yield Finding(Check.AXES, f"axis {name} ends at {speed:.6g} per second, not {_shown(allowed)}")
    for box in expect.avoid:
        when = enters(record, box)
        if when is not None:
            yield Finding(Check.ZONE, f"the forbidden zone is entered at {when:.3f} s")
    if expect.within:
        when = leaves(record, expect.within)
        if when is not None:
            yield Finding(Check.ZONE, f"the allowed zone is left at {when:.3f} s")


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
