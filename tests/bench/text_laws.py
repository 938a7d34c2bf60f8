"""The laws of motion on random programs as text: simulated, or played beside a planner under orders."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.curves import Array
from mcserver.simulation.simulation import Simulation, simulate
from tests.bench.override import Run, play
from tests.bench.shaped_machines import shaped
from tests.bench.text_programs import TOLERANCES, Asked, Text, orders_of, text_program_of
from tests.limits import broken_limits, limits_of
from tests.motion.measure import VELOCITY_SLACK

# What rounding may take away from an end [m or rad].
EXACT = 1e-9
# A comma group that travels less may move by the rounded corner to a line in which it is quicker
# [mm or degrees].
ROUNDED = 10.0 * max(TOLERANCES)


def broken_laws_of_text(seed: int, *, orders: bool, shapers: bool = False) -> tuple[list[str], int, int]:
    """Name the laws that the program of a seed breaks; and return its lines and cycles.

    Args:
        orders: play it beside a planner that works meanwhile, under overrides of 0 to 200 %, its lines all
            there at once or streamed. shapers: axes have random ones.
    """
    text = text_program_of(seed)
    if shapers:
        text = replace(text, machine=shaped(text.machine, seed))
    if orders:
        given, every = orders_of(seed)
        run = play(text.machine, text.lines, given, every=every)
        broken = _broken_limits(text, run)
        if run.faults:
            broken.append(f"{run.faults} faults")
        if run.lines != sorted(set(run.lines)):
            broken.append("a line is not reported once and in order")
        return broken, len(text.lines), len(run.setpoint)
    found = simulate("\n".join(["G1010", *text.lines]), text.machine, record=True)
    if found.exit_code or found.recording is None:
        return [f"refused: {found.report['diagnostics'][:1]}"], 0, 0
    rows = found.recording.setpoint * _units(text.machine)
    broken = _broken_limits(text, Run(rows, 0.0, [], 0, np.empty(0), 0)) + _broken_requests(text, found)
    return broken, len(text.lines), len(rows)


def _units(machine: Machine) -> Array:
    """Return SI in one millimetre or degree of each axis, shape (K,)."""
    return np.array([axis.type.si_per_unit for axis in machine.axes])


def _broken_limits(text: Text, run: Run) -> list[str]:
    """Name the limits that setpoints pass; a tolerance or a stop is at each vertex, so jerk holds too."""
    broken = broken_limits(run.setpoint, limits_of(text.machine), text.machine.cycle_s)
    if np.abs(run.setpoint[-1] - text.end * _units(text.machine)).max() > EXACT:
        broken.append("the end is missed")
    return broken


def _broken_requests(text: Text, found: Simulation) -> list[str]:
    """Name the lines that pass F, end before their T, or after it with no limit to name."""
    assert found.recording is not None
    known = {line["line"]: line for line in found.report["lines"]}
    cycle, broken = text.machine.cycle_s, []
    longest: dict[int, float] = {}
    groups = Counter(asked.line for asked in text.asked)
    for asked in text.asked:
        if asked.line not in known:
            continue
        line = known[asked.line]
        start, end = line["start_s"] / cycle, line["end_s"] / cycle
        if asked.duration is not None:
            longest[asked.line] = max(longest.get(asked.line, 0.0), asked.duration)
        elif asked.speed is not None and (groups[asked.line] == 1 or asked.travel > ROUNDED):
            rows = found.recording.setpoint[math.ceil(start - 1e-6) : math.floor(end + 1e-6) + 1]
            broken += _too_fast(asked, asked.speed, rows, cycle)
    for number, duration in longest.items():
        line = known[number]
        late = line["end_s"] - line["start_s"] - duration
        if late < -cycle:
            broken.append(f"line {number} ends {-late:.6g} s before its T of {duration:.6g}")
        if late > cycle and line["bound_by"] is None:
            broken.append(f"line {number} ends {late:.6g} s after its T of {duration:.6g}, unbound")
    return broken


def _too_fast(asked: Asked, speed: float, rows: Array, cycle: float) -> list[str]:
    if len(rows) < 2:
        return []
    found = np.linalg.norm(np.diff(rows[:, list(asked.columns)], axis=0), axis=1).max() / cycle / speed
    return [] if found <= VELOCITY_SLACK else [f"F {found:.6g} > {VELOCITY_SLACK} in line {asked.line}"]
