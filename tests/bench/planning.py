"""From text to setpoints by `mcserver.simulation`: lines a second and milliseconds a segment."""

from __future__ import annotations

import math

from mcserver.config import load_machine
from mcserver.gcode.interpreter import Interpreter
from tests.bench.figures import Figure, rate
from tests.bench.machines import ideal

LINES = 4000


def measure() -> list[Figure]:
    """A polyline of short segments (continuous motion) and the time law alone."""
    from mcserver.simulation import simulate

    polyline = [
        f"G01 X{20 * math.cos(i / 40):.4f} Y{20 * math.sin(i / 40):.4f} Z{i / 1000:.4f}" for i in range(LINES)
    ]
    text = "\n".join(["G1010", "G94 F6000", "G01 X20", *polyline])
    machine = ideal(axes=6)

    def parse() -> None:
        interpreter = Interpreter(machine)
        for number, line in enumerate(text.split("\n"), start=1):
            interpreter.interpret_text(line, number)

    parsed = rate(parse, LINES, runs=3)
    simulated = rate(lambda: simulate(text, machine), LINES, runs=3)
    return [
        Figure(
            "short segments to setpoints and encoders",
            simulated,
            "lines/s",
            parsed,
            "parse and interpret alone",
            "50 k",
        ),
        Figure(
            "of it, planning and playing a segment",
            1000.0 * (1.0 / simulated - 1.0 / parsed),
            "ms",
            1000.0 / parsed,
            "parse and interpret alone",
            "planning ≤ 0.15 ms with jerk",
        ),
        Figure(
            "arcs of the reference to setpoints",
            rate(lambda: simulate(ARCS, load_machine("cartesian")), 13, 3),
            "lines/s",
        ),
    ]


ARCS = """G1010
G94 F30000
G00 X0 Y0
G01 V1000
G02 X1000 Y2000 R1000
G01 U1000
G02 X3000 Y1000 R1000
G01 V-1000
G02 X2000 Y-1000 I-1000 J0
G01 U-1000
G02 X0 Y0 I0 J1000
G01 U500 V500
G02 X500 Y500 I1000 J0
"""
