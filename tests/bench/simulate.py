"""How much faster than the machine a simulation runs, planning included, by processor time."""

from __future__ import annotations

import math
import statistics
import time

from mcserver.machine.machine_file import Machine, builtin_text, parse_machine
from mcserver.processes import collect_seldom
from tests.bench.figures import Figure
from tests.bench.machines import ideal
from tests.bench.real_files import MACHINE, POSTS

STROKES, CHORD = 200, 0.1
RUNS = 3
# Of the files of real_files those with the most besides motion.
IN_THE_MANNER_OF, LINES = ("S on each line (laser)", "retracts"), 10_000


def measure() -> list[Figure]:
    """Long lines and short chords, with drives that follow exactly and with simulated ones."""
    # as in the command
    collect_seldom()
    programs = {"lines of 80 mm": _strokes(), f"chords of {CHORD} mm": _chords()}
    figures = []
    for name, text in programs.items():
        figures.append(_figure(f"{name}, ideal drives", text, ideal(axes=3), "≥ 100 × machine time"))
    text = programs["lines of 80 mm"]
    simulated = ideal(axes=3, kind="simulated")
    figures.append(_figure("lines of 80 mm, simulated drives", text, simulated, "≥ 30 × machine time"))
    machine = parse_machine(builtin_text("cartesian") + MACHINE)
    for post in IN_THE_MANNER_OF:
        figures.append(_figure(f"{post}, simulated drives", _post(post), machine, "≥ 100 × machine time"))
    return figures


def _post(name: str) -> str:
    head, line = POSTS[name]
    points = ((k, 50.0 * math.cos(k * 0.01), 50.0 * math.sin(k * 0.01)) for k in range(LINES))
    return "\n".join([head, *(line(*point) for point in points), "M2"])


def _strokes() -> str:
    lines = [f"X{80 * (number % 2)} Y{number % 7}" for number in range(STROKES)]
    return "G1010\nG94 F6000\nG01 X0\n" + "\n".join(lines)


def _chords() -> str:
    """A circle of 50 mm radius, ten turns."""
    count = round(10.0 * 2.0 * math.pi * 50.0 / CHORD)
    points = [
        (50.0 * math.sin(n * CHORD / 50.0), 50.0 * (1.0 - math.cos(n * CHORD / 50.0))) for n in range(count)
    ]
    return "G1010\nG94 F6000\nG01 X0\n" + "\n".join(f"X{x:.5f} Y{y:.5f}" for x, y in points)


def _figure(what: str, text: str, machine: Machine, goal: str) -> Figure:
    from mcserver.simulation.simulation import simulate

    machine_time = float(simulate(text, machine).report["duration_s"])
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        simulate(text, machine)
        times.append(time.process_time() - start)
    return Figure(what, machine_time / statistics.median(times), "×", 1.0, "the machine's own time", goal)
