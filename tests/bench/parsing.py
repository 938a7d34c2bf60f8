"""Lines a second from text to canonical motion, beside reading the same numbers and nothing more."""

from __future__ import annotations

import re

from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, load_machine
from tests.bench.figures import Figure, rate

LINES = 20_000
CHECKED = 200_000
NUMBER = re.compile(r"[A-Z](-?[0-9.]+)")


def measure() -> list[Figure]:
    """G01 lines in runs and one by one, arcs, and a whole check."""
    machine = load_machine("cartesian")
    straight = lines_of(LINES)
    arcs = [f"G02 X{100 * (i % 2)} Y0 R{60 + i % 40}" for i in range(1, LINES + 1)]
    text = "\n".join(["G94 F6000", *lines_of(CHECKED)])
    mixed = "\n".join(["G94 F6000", *slots(CHECKED)])
    floor = rate(lambda: read_numbers(straight), LINES)
    against = "one regular expression and float() a word"
    return [
        Figure(
            "G01 with three axes, runs",
            rate(lambda: interpret_runs(machine, straight), LINES),
            "lines/s",
            floor,
            against,
            "2 × rs274 (440 k)",
        ),
        Figure(
            "G01 with three axes, line by line",
            rate(lambda: interpret(machine, straight), LINES),
            "lines/s",
            floor,
            against,
            "50 k",
        ),
        *[
            Figure(
                name,
                rate(lambda lines=lines: interpret_runs(machine, lines), LINES),
                unit,
                rate(lambda lines=lines: read_numbers(lines), LINES),
                against,
                "rs274 (230 k)",
            )
            for name, lines, unit in (
                ("G02 by radius", arcs, "arcs/s"),
                ("G03 by I and J, line numbers, F", numbered_arcs(LINES), "arcs/s"),
                ("G01 and G02 in turn, as CAM writes them", slots(LINES), "lines/s"),
            )
        ],
        Figure(
            "G02 by radius, line by line",
            rate(lambda: interpret(machine, arcs), LINES),
            "arcs/s",
            rate(lambda: read_numbers(arcs), LINES),
            against,
            "50 k",
        ),
        Figure(
            f"check of {CHECKED} lines of G01",
            rate(lambda: check_program(text, machine), CHECKED, runs=3),
            "lines/s",
            floor,
            against,
        ),
        Figure(
            f"check of {CHECKED} lines and arcs",
            rate(lambda: check_program(mixed, machine), CHECKED, runs=3),
            "lines/s",
            floor,
            against,
        ),
    ]


def lines_of(count: int) -> list[str]:
    """G01 with three axes."""
    return [f"G01 X{i % 500}.{i % 10} Y{(i * 7) % 300} Z{i % 50}" for i in range(count)]


def numbered_arcs(count: int) -> list[str]:
    """Half circles on end, and back by a line."""
    return [
        f"N{10 * i} G03 X{2 * (i % 400) + 2}.000 Y0.000 I1.000 J0.000 F{600 + i % 5}"
        if i % 400
        else "G01 X2. Y0."
        for i in range(count)
    ]


def slots(count: int) -> list[str]:
    """Line, arc, line, arc, with the words that each needs."""
    lines: list[str] = []
    for i in range(count // 4):
        x = 10.0 * (i % 50)
        lines += [f"G1 X{x + 5:.3f} Y0.000", f"G2 X{x + 7:.3f} Y-2.000 I0 J-2.0"]
        lines += ["G1 Y-20.", f"G3 X{x + 10:.3f} Y-23. R3."]
    return lines


def interpret(machine: Machine, lines: list[str]) -> None:
    """Line by line."""
    interpreter = Interpreter(machine)
    interpreter.interpret_text("G94 F6000", 1)
    for number, line in enumerate(lines, start=2):
        interpreter.interpret_text(line, number)


def interpret_runs(machine: Machine, lines: list[str]) -> None:
    """In columns."""
    interpreter = Interpreter(machine)
    interpreter.interpret_text("G94 F6000", 1)
    done = 0
    while done < len(lines):
        found = interpreter.interpret_batch(lines[done : done + interpreter.batch_window(done + 2)], done + 2)
        if found is None:
            interpreter.interpret_text(lines[done], done + 2)
        done += 1 if found is None else found.taken


def read_numbers(lines: list[str]) -> None:
    """The floor."""
    for line in lines:
        [float(number) for number in NUMBER.findall(line)]
