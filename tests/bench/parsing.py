"""Lines a second from text to canonical motion, beside reading the same numbers and nothing more."""

from __future__ import annotations

import re

from mcserver.config import load_machine
from mcserver.gcode.interpreter import Interpreter
from tests.bench.figures import Figure, rate

LINES = 20_000
NUMBER = re.compile(r"[A-Z](-?[0-9.]+)")


def measure() -> list[Figure]:
    """G01 lines and arcs."""
    straight = [f"G01 X{i % 500}.{i % 10} Y{(i * 7) % 300} Z{i % 50}" for i in range(LINES)]
    arcs = [f"G02 X{100 * (i % 2)} Y0 R{60 + i % 40}" for i in range(1, LINES + 1)]
    return [
        Figure(
            "G01 with three axes",
            rate(lambda: interpret(straight), LINES),
            "lines/s",
            rate(lambda: read_numbers(straight), LINES),
            "one regular expression and float() a word",
            "50 k, then 2 × rs274 (440 k)",
        ),
        Figure(
            "G02 by radius",
            rate(lambda: interpret(arcs), LINES),
            "arcs/s",
            rate(lambda: read_numbers(arcs), LINES),
            "the same",
            "50 k",
        ),
    ]


def interpret(lines: list[str]) -> None:
    """The way of the server, line by line."""
    interpreter = Interpreter(load_machine("cartesian"))
    interpreter.interpret_text("G94 F6000", 1)
    for number, line in enumerate(lines, start=2):
        interpreter.interpret_text(line, number)


def read_numbers(lines: list[str]) -> None:
    """The floor."""
    for line in lines:
        [float(number) for number in NUMBER.findall(line)]
