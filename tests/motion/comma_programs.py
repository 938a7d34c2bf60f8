"""Random programs of comma lines by seed, each beside plain lines, and what a planner makes of them."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

import numpy as np

from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup, MotionLine, one_path
from mcserver.motion.geometry.curves import Array, Curve
from mcserver.motion.pieces import LineEdges, Piece
from mcserver.motion.planner import MotionPlanner
from tests.motion.support import (
    AxisSpec,
    Motion,
    arc_curve,
    at_speed,
    collect,
    in_time,
    line_curve,
    machine_of,
)

# Travels of a group [m or rad], and times that groups ask for [s]: alike, and short beside long.
LENGTHS = (2e-4, 1e-3, 5e-3, 0.02, 0.05)
TIMES = (0.05, 0.1, 0.2, 0.4)
MIXED_TIMES = (0.004, 0.02, 0.05, 0.2, 0.4, 1.5)


@dataclass(frozen=True)
class CommaProgram:
    """A machine, its lines with their groups, how far corners may be rounded [m], and after which lines the
    planner has to hand over, and how many cycles.
    """

    machine: Machine
    lines: tuple[tuple[FeedGroup, ...], ...]
    tolerance: float
    commits: dict[int, float]


def comma_program(
    seed: int, *, jerk: bool = True, tolerance: float | None = None, times: tuple[float, ...] = TIMES
) -> CommaProgram:
    """Return the program of a seed: two to three mechanisms of one or two axes, 2 to 9 lines.

    Args:
        times: that groups under G93 ask for [s].
    """
    draw = random.Random(seed)
    machine = _machine(draw, jerk=jerk)
    mechanisms = _mechanisms(draw, machine)
    position = np.zeros(len(machine.axes))
    headings: dict[tuple[int, ...], Array] = {}
    lines = []
    timed = draw.random() < 0.5
    for _ in range(draw.randint(2, 9)):
        if draw.random() < 0.15:
            timed = not timed
        count = 1 if draw.random() < 0.2 else len(mechanisms)
        chosen = draw.sample(mechanisms, count)
        lines.append(
            tuple(
                _group(draw, machine, axes, position, headings, times=times if timed else ())
                for axes in chosen
            )
        )
    allowed = draw.choice((0.0, 1e-5, 1e-4)) if tolerance is None else tolerance
    commits = {
        draw.randint(1, len(lines)): draw.choice((1.0, 20.0, 150.0, math.inf))
        for _ in range(draw.choice((0, 0, 2, 6)))
    }
    return CommaProgram(machine, tuple(lines), allowed, commits)


def _machine(draw: random.Random, *, jerk: bool) -> Machine:
    specs = []
    for index in range(draw.randint(3, 5)):
        rotary = index > 2 and draw.random() < 0.5
        specs.append(
            AxisSpec(
                velocity=draw.choice((100.0, 300.0)),
                acceleration=draw.choice((1000.0, 4000.0)),
                jerk=draw.choice((30_000.0, 200_000.0)) if jerk else None,
                rotary=rotary,
            )
        )
    return machine_of(specs)


def _mechanisms(draw: random.Random, machine: Machine) -> list[tuple[int, ...]]:
    axes = list(range(len(machine.axes)))
    first = draw.choice((1, 2))
    found = [tuple(axes[:first])]
    rest = axes[first:]
    second = draw.choice((1, 2)) if len(rest) > 1 else 1
    found.append(tuple(rest[:second]))
    if len(rest) > second and draw.random() < 0.5:
        found.append((rest[second],))
    return found


def _group(
    draw: random.Random,
    machine: Machine,
    axes: tuple[int, ...],
    position: Array,
    headings: dict[tuple[int, ...], Array],
    *,
    times: tuple[float, ...],
) -> FeedGroup:
    start = position[list(axes)].copy()
    length = draw.choice(LENGTHS)
    plane = len(axes) == 2 and all(machine.axes[axis].type.unit == "mm" for axis in axes)
    curve: Curve
    if plane and draw.random() < 0.25:
        sweep = draw.choice((1.0, -2.0))
        angle = draw.uniform(-math.pi, math.pi)
        centre = (start[0] + length * math.cos(angle), start[1] + length * math.sin(angle))
        curve = arc_curve(start.tolist(), centre, sweep, axes=axes)
    else:
        heading = headings.get(axes)
        if heading is None or draw.random() < 0.4:
            heading = np.array([draw.choice((1.0, -1.0, 0.4)) for _ in axes])
            headings[axes] = heading = heading / np.linalg.norm(heading)
        curve = line_curve(machine, axes, start.tolist(), (start + length * heading).tolist())
    position[list(axes)] = curve.position(np.array([1.0]))[0]
    mixed = len({machine.axes[axis].type for axis in axes}) > 1
    rotary = machine.axes[axes[0]].type.unit != "mm"
    if times or mixed or (rotary and len(axes) > 1):
        return in_time(draw.choice(times or TIMES), curve)
    share = draw.choice((0.2, 0.6, 1.5))
    return at_speed(share * min(machine.axes[axis].max_velocity for axis in axes), curve)


def run(program: CommaProgram, *, at_rest: bool = False) -> Motion:
    """Plan a program.

    Args:
        at_rest: comma lines of several T start and end at rest, as rapids do.
    """
    machine, start = program.machine, np.zeros(len(program.machine.axes))
    planner = MotionPlanner(machine, start)
    pieces: list[Piece] = []
    for number, groups in enumerate(program.lines, start=1):
        path = one_path(MotionLine(number, groups))
        if path is not None:
            planner.append(planner.segment(path, number), tolerance=program.tolerance)
        else:
            found = None if at_rest else planner.comma_line(list(groups), number, program.tolerance)
            if found is not None:
                planner.append(found.segment, tolerance=program.tolerance, companions=found.companions)
            else:
                pieces += planner.close()
                begin = planner.u
                made, _, end = planner.together(list(groups), number)
                pieces += [_edge(begin, number, ends=False), *made, _edge(end, number, ends=True)]
        if number in program.commits:
            pieces += planner.commit(planner.u + program.commits[number]) or ()
    pieces += planner.close()
    return collect(machine, [], start, pieces)


def _edge(u: float, line: int, *, ends: bool) -> LineEdges:
    return LineEdges(np.array([u]), np.array([line]), np.array([ends]))
