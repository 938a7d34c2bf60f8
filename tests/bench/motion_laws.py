"""The laws of motion on random programs: ``make laws ARGS="--first 0 --count 1000"``.

Each seed is a machine, a program of lines, arcs, timed lines and chords of curves, and moments at which the
planner has to hand over. Judged from outside, on the rows (`tests.motion.measure`): velocity, acceleration
and jerk of every axis at every cycle, F, the tolerance in both directions, every line reported once and in
order, and the end; a T is not ended sooner than it says, and later only with a limit to name. With
``--orders`` each program is played too, under random holds and overrides of 0 to 200 %, its rows as if
planned for 100 % or for more, and stopped (`tests.bench.order_laws`). ``--wide`` draws from
`tests.bench.wide_programs`, ``--timed`` chains of timed lines from `tests.bench.timed_programs`, ``--text``
programs as text from `tests.bench.text_programs`, ``--tools`` those of an arm's tool from
`tests.bench.tool_programs`; these two are simulated, or with ``--orders`` played beside the planner. With
``--shaped`` axes have random shapers, and what drives get is judged under orders. ``--servo`` draws hostile
streams of targets from `tests.bench.servo_streams`. Seeds that break a law are printed; each replays alone.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import itertools
import math
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

from mcserver.machine.machine_file import Machine
from mcserver.motion.bound import PlanningError
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.curves import Array
from tests.bench.order_laws import MOST_ROWS, broken_by_stops, broken_under_orders
from tests.bench.servo_streams import broken_laws_of_streams
from tests.bench.shaped_machines import shaped
from tests.bench.text_laws import broken_laws_of_text
from tests.bench.timed_programs import many_commits, timed_moves
from tests.bench.tool_programs import broken_laws_of_tools
from tests.bench.wide_programs import wide_program_of
from tests.motion.measure import (
    ACCELERATION_SLACK,
    JERK_SLACK,
    VELOCITY_SLACK,
    acceleration_ratio,
    bow_of,
    end_of,
    from_path_by_line,
    jerk_ratio,
    path_missed_by_line,
    row_velocity_ratio,
    speed_over_feed,
    velocity_ratio,
    vertices_of,
)
from tests.motion.support import (
    AxisSpec,
    Commit,
    Motion,
    Move,
    arc_curve,
    at_speed,
    in_time,
    line_curve,
    machine_of,
    plan,
)

Judge = Callable[[int], tuple[list[str], int, int]]
Draw = Callable[[int], tuple[Machine, list[Move], list[Commit]]]

REPORT_S = 60.0
# What rounding may take away from a path [m].
EXACT = 1e-9
# Most lines that a section of a program has.
LONGEST = 60
# What a plan may end a T late by, with no limit to name, through rounding [s].
LATE = 1e-6
JERKS = (None, 20_000.0, 50_000.0, 200_000.0, 2_000_000.0)
TOLERANCES = (0.0, 1e-5, 5e-5, 5e-4)


def machine_from(rng: np.random.Generator) -> Machine:
    """Two or three linear axes, alike or each with limits of its own, all with a jerk limit or none."""
    count, limited = int(rng.integers(2, 4)), rng.random() < 0.85
    specs = [
        AxisSpec(
            float(rng.choice([50.0, 200.0, 1000.0])),
            float(rng.choice([500.0, 2000.0, 20_000.0])),
            float(rng.choice([jerk for jerk in JERKS if jerk is not None])) if limited else None,
        )
        for _ in range(count)
    ]
    return machine_of([specs[0]] * count if rng.random() < 0.5 else specs)


def curve_points(rng: np.random.Generator, count: int) -> Array:
    """Points along a circle, a clothoid, a Lissajous figure or a wave, from the origin, shape (n, 2) [m]."""
    chord = float(rng.choice([5e-5, 2e-4, 5e-4, 2e-3]))
    along = np.arange(count + 1) * chord
    kind = int(rng.integers(4))
    if kind < 2:
        bend = rng.choice([-1.0, 1.0]) / float(rng.choice([2e-3, 1e-2, 5e-2]))
        heading = bend * along if kind == 0 else bend * along**2 / (2.0 * along[-1])
        heading = heading + rng.uniform(-3.0, 3.0)
        steps = chord * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        points = np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])
    elif kind == 2:
        size, phase = float(rng.choice([5e-3, 3e-2])), rng.uniform(0.0, 6.0)
        angle = along / (2.0 * size)
        points = size * np.stack([np.sin(2.0 * angle + phase), np.sin(3.0 * angle)], axis=1)
    else:
        wave = float(rng.choice([3e-3, 2e-2]))
        points = np.stack([along, 0.1 * wave * np.sin(2.0 * math.pi * along / wave)], axis=1)
    points = points - points[0]
    digits = int(rng.integers(6, 9))
    rounded: Array = np.round(points, digits)
    keep = np.concatenate([[True], np.abs(np.diff(rounded, axis=0)).max(axis=1) > 0.0])
    return rounded[keep]


def section(rng: np.random.Generator, machine: Machine, start: Array) -> Iterator[FeedGroup]:
    """One kind of lines, from ``start`` on, which moves to their end."""
    width = len(machine.axes)
    axes = tuple(range(width))
    fastest = min(axis.max_velocity for axis in machine.axes)
    speed = fastest * float(rng.choice([0.05, 0.3, 0.9, 1.5]))
    kind = str(rng.choice(["chords", "chords", "lines", "timed", "arcs"]))
    if kind == "arcs":
        for _ in range(int(rng.integers(1, 4))):
            radius, angle = float(rng.choice([1e-3, 1e-2, 0.05])), rng.uniform(-3.1, 3.1)
            centre = (start[0] + radius * math.cos(angle), start[1] + radius * math.sin(angle))
            arc = arc_curve(start[:2].tolist(), centre, float(rng.choice([0.3, 1.5, -1.5, -4.0, 6.2])))
            start[:2] = arc.end[:2]
            yield at_speed(speed, arc)
        return
    count = int(rng.integers(2, LONGEST))
    if kind == "chords" or (kind == "timed" and rng.random() < 0.5):
        plane = curve_points(rng, count)
        points = np.zeros((len(plane), width))
        points[:, :2] = plane
        if width > 2 and rng.random() < 0.5:
            points[:, 2] = np.round(
                np.linspace(0.0, rng.uniform(-0.2, 0.2) * len(plane) * 5e-4, len(plane)), 7
            )
    else:
        length = float(rng.choice([1e-4, 2e-3, 2e-2]))
        steps = rng.normal(size=(min(count, 15), width)) * length
        if rng.random() < 0.5:
            # nearly straight on
            steps = steps[0] + 0.1 * steps
        points = np.concatenate([np.zeros((1, width)), np.cumsum(steps, axis=0)])
    spread = float(rng.choice([0.0, 0.3]))
    for here, there in itertools.pairwise(points):
        line = line_curve(machine, axes, (start + here).tolist(), (start + there).tolist())
        if kind == "timed":
            yield in_time(max(line.length, 1e-6) / speed * math.exp(spread * rng.normal()), line)
        else:
            yield at_speed(speed, line)
    start += points[-1]


def program_of(seed: int) -> tuple[Machine, list[Move], list[Commit]]:
    """The machine, the moves and the commits of a seed."""
    rng = np.random.default_rng(seed)
    machine = machine_from(rng)
    tolerance, here = float(rng.choice(TOLERANCES)), np.zeros(len(machine.axes))
    moves: list[Move] = []
    for _ in range(int(rng.integers(1, 4))):
        for group in section(rng, machine, here):
            moves.append(Move(group, rng.random() < 0.01, tolerance))
    ahead = [1.0, 50.0, 200.0, 1000.0, math.inf]
    after = np.sort(rng.integers(1, len(moves) + 1, size=int(rng.integers(0, 6)))).tolist()
    return machine, moves, [Commit(number, float(rng.choice(ahead)), rng.random() < 0.1) for number in after]


def timed_program_of(seed: int) -> tuple[Machine, list[Move], list[Commit]]:
    """The machine, the moves and the commits of a seed, nearly all of them timed lines."""
    rng = np.random.default_rng((seed, 93))
    machine = machine_from(rng)
    moves = timed_moves(rng, machine, float(rng.choice(TOLERANCES)))
    return machine, moves, many_commits(rng, len(moves))


def broken_laws(motion: Motion) -> list[str]:
    """Name the laws that a motion breaks, each with its figure."""
    machine, lines = motion.machine, list(range(1, len(motion.moves) + 1))
    if list(motion.starts) != lines or list(motion.ends) != lines:
        return ["a line is not reported once and in order"]
    # a corner is rounded within the tolerance of the line behind it
    corner = np.array([move.tolerance for move in motion.moves])
    tolerance = np.maximum(corner, np.append(corner[1:], 0.0))
    exact = vertices_of(motion, tolerance=0.0)
    measured = [
        ("velocity", velocity_ratio(motion), VELOCITY_SLACK),
        ("velocity of rows", row_velocity_ratio(motion), VELOCITY_SLACK),
        ("acceleration", acceleration_ratio(motion), ACCELERATION_SLACK),
        ("jerk", jerk_ratio(motion, vertices=exact), JERK_SLACK),
        ("F", speed_over_feed(motion), VELOCITY_SLACK),
        ("path left by [m]", *_worst(from_path_by_line(motion), tolerance + EXACT)),
        ("path missed by [m]", *_worst(path_missed_by_line(motion), tolerance + bow_of(motion) + EXACT)),
    ]
    broken = [f"{name} {value:.6g} > {most:.6g}" for name, value, most in measured if not value <= most]
    broken += broken_times(motion)
    if np.abs(motion.position[-1] - end_of(machine, motion.moves, motion.start)).max() > EXACT:
        broken.append("the end is missed")
    if motion.velocity[-1].any():
        broken.append("not at rest at the end")
    return broken


def _worst(values: Array, most: Array) -> tuple[float, float]:
    """Return the value that passes its own limit by most, or is nearest to it, and that limit."""
    worst = int(np.argmax(values - most))
    return float(values[worst]), float(most[worst])


def broken_times(motion: Motion) -> list[str]:
    """Name the lines that end before their T, and those that end after it with no limit to name."""
    broken = []
    for line, move in enumerate(motion.moves, start=1):
        if move.group.duration is None:
            continue
        late = motion.took(line) - move.group.duration
        if late < -motion.cycle:
            broken.append(f"line {line} ends {-late:.6g} s before its T of {move.group.duration:.6g}")
        if late > LATE and line not in motion.bounds:
            broken.append(f"line {line} ends {late:.6g} s after its T of {move.group.duration:.6g}, unbound")
    return broken


def judge(seed: int, draw: Draw, *, orders: bool, shapers: bool) -> tuple[list[str], int, int]:
    """Name the laws that the program of a seed breaks; and return its lines and cycles."""
    machine, moves, commits = draw(seed)
    motion = plan(machine, moves, commits=commits)
    broken = broken_laws(motion)
    if shapers:
        motion = dataclasses.replace(motion, machine=shaped(machine, seed))
    if orders and len(motion.position) <= MOST_ROWS:
        broken += broken_under_orders(motion, seed) + broken_by_stops(motion, seed)
    return broken, len(moves), len(motion.position)


def run(first: int, count: int, judged: Judge) -> int:
    """Run the seeds; return how many break a law."""
    started = reported = time.monotonic()
    failed = lines = rows = 0
    for seed in range(first, first + count):
        try:
            broken, count_of_lines, count_of_rows = judged(seed)
        except (AssertionError, PlanningError) as error:
            broken = [f"{type(error).__name__} {error}".splitlines()[0]]
        else:
            lines, rows = lines + count_of_lines, rows + count_of_rows
        if broken:
            failed += 1
            print(f"seed {seed}: {'; '.join(broken)}", flush=True)
        now = time.monotonic()
        if now - reported >= REPORT_S:
            reported = now
            print(f"{now - started:7.0f} s  {seed + 1 - first} programs, {failed} failed", flush=True)
    print(
        f"{count} programs from seed {first}, {lines} lines or messages, {rows} cycles: {failed} break a law"
    )
    return failed


def main() -> int:
    """The exit code: 0 where every program keeps the laws."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--count", type=int, default=10_000)
    options.add_argument("--orders", action="store_true")
    options.add_argument("--wide", action="store_true")
    options.add_argument("--timed", action="store_true")
    options.add_argument("--text", action="store_true")
    options.add_argument("--tools", action="store_true")
    options.add_argument("--servo", action="store_true")
    options.add_argument("--shaped", action="store_true")
    chosen = options.parse_args()
    judged: Judge
    if chosen.servo:
        judged = broken_laws_of_streams
    elif chosen.tools:
        judged = functools.partial(broken_laws_of_tools, orders=chosen.orders)
    elif chosen.text:
        judged = functools.partial(
            broken_laws_of_text, orders=chosen.orders or chosen.shaped, shapers=chosen.shaped
        )
    else:
        draw = wide_program_of if chosen.wide else timed_program_of if chosen.timed else program_of
        orders = chosen.orders or chosen.shaped
        judged = functools.partial(judge, draw=draw, orders=orders, shapers=chosen.shaped)
    return min(run(chosen.first, chosen.count, judged), 1)


if __name__ == "__main__":
    sys.exit(main())
