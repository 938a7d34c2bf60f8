"""From text to setpoints: the planner alone, and the whole of `mcserver.simulation.simulation` beside it."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np

from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.canonical import FeedGroup, MotionLine, PathBatch
from mcserver.motion.planner import MotionPlanner
from mcserver.planning.pipeline import RUN
from mcserver.processes import collect_seldom
from tests.bench.figures import Figure, seconds
from tests.bench.machines import ideal
from tests.bench.parsing import slots

LINES = 5000
ARCS = Path(__file__).resolve().parents[2] / "examples" / "arcs.gcode"


def measure() -> list[Figure]:
    """A smooth polyline of six axes' machine, with and without jerk limit, and the reference's arcs."""
    from mcserver.simulation.simulation import simulate

    # as in the planner's process
    collect_seldom()
    polyline = [
        f"G01 X{20 * math.cos(i / 40):.4f} Y{20 * math.sin(i / 40):.4f} Z{i / 1000:.4f}"
        for i in range(1, LINES + 1)
    ]
    figures = []
    for name, jerk in (("with jerk", 50_000.0), ("without jerk", None)):
        machine = ideal(axes=6, jerk=jerk)
        parsed = seconds(lambda machine=machine: canonical(polyline, machine), runs=3)
        lines = canonical(polyline, machine)
        planned = seconds(lambda machine=machine, lines=lines: setpoints(lines, machine), runs=3)
        figures += [
            Figure(
                f"text → setpoints, {name}",
                LINES / (parsed + planned),
                "lines/s",
                LINES / parsed,
                "parse and interpret alone",
                "50 k",
            ),
            Figure(
                f"planning a segment, {name}",
                1000.0 * planned / LINES,
                "ms",
                1000.0 * parsed / LINES,
                "parsing it",
                "≤ 0.15 ms" if jerk else "",
            ),
        ]
    figures.append(_with_tolerance(polyline))
    figures.append(_arcs())
    simulated = (
        ("examples/arcs.gcode", ARCS.read_text("utf-8"), load_machine("cartesian")),
        ("chords of 0.5 mm of an arm's tool", _chords(), _arm()),
    )
    for name, text, machine in simulated:
        kinematics = build_kinematics(machine)
        motion = simulate(text, machine, kinematics=kinematics).report["duration_s"]
        took = seconds(
            lambda text=text, machine=machine, kinematics=kinematics: simulate(
                text, machine, kinematics=kinematics
            ),
            runs=3,
        )
        figures.append(Figure(f"simulating {name}", took, "s", motion, "the motion itself", "far below 1"))
    return figures


def _arm() -> Machine:
    return msgspec.structs.replace(load_machine("arm6"), path_tolerance=1e-4)


def _chords() -> str:
    """A circle of an arm's tip at 50 mm/s."""
    angles = np.linspace(0.0, math.tau, 501)[1:].tolist()
    lines = [f"X{420.0 + 40.0 * math.cos(angle):.4f} Y{40.0 * math.sin(angle):.4f}" for angle in angles]
    return "\n".join(["G1010", "G94 F3000", "G1 T1 X460 Y0 Z600", *[f"G1 T1 {line}" for line in lines]])


def _arcs() -> Figure:
    """Lines and arcs in turn, as CAM writes them, with a jerk limit."""
    return _flowing(
        "text → setpoints, lines and arcs in turn, with jerk", slots(LINES), ideal(axes=6, jerk=50_000.0)
    )


def _with_tolerance(polyline: list[str]) -> Figure:
    """The same lines as one curve within 0.05 mm."""
    return _flowing(
        "text → setpoints, with jerk and a tolerance of 0.05 mm",
        polyline,
        ideal(axes=6, jerk=50_000.0, tolerance_mm=0.05),
        "50 k",
    )


def _flowing(name: str, lines: list[str], machine: Machine, goal: str = "") -> Figure:
    parsed = seconds(lambda: canonical(lines, machine), runs=3)
    found = canonical(lines, machine)
    setpoints(found, machine)
    planned = seconds(lambda: setpoints(found, machine), runs=3)
    return Figure(
        name, LINES / (parsed + planned), "lines/s", LINES / parsed, "parse and interpret alone", goal
    )


def canonical(lines: list[str], machine: Machine) -> list[MotionLine | PathBatch]:
    """Parsed and interpreted, as a program's pipeline does it."""
    interpreter = Interpreter(machine)
    interpreter.interpret_text("G94 F6000", 1)
    found: list[MotionLine | PathBatch] = []
    at = 0
    while at < len(lines):
        window = min(interpreter.batch_window(at + 2), RUN)
        run = interpreter.interpret_batch(lines[at : at + window], at + 2) if window else None
        if run is not None:
            found += run.values
            at += run.taken
            continue
        found += [
            line for line in interpreter.interpret_text(lines[at], at + 2) if isinstance(line, MotionLine)
        ]
        at += 1
    return found


def setpoints(lines: list[MotionLine | PathBatch], machine: Machine) -> None:
    """Planned with lookahead, and sampled at the cycle."""
    planner = MotionPlanner(machine, np.zeros(len(machine.axes)))
    for line in lines:
        if planner.full:
            list(planner.commit() or ())
        if isinstance(line, PathBatch):
            assert planner.append_run(line, tolerance=float(line.tolerances[0]))
            continue
        group = line.groups[0]
        assert isinstance(group, FeedGroup)
        planner.append(planner.segment(group, line.line), tolerance=line.tolerance)
    list(planner.close())
