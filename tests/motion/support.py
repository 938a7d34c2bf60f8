"""Machines, moves and motions for the laws of motion: what is asked of a planner, and all that it gives."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from mckinematics.dynamics import JointDynamics

from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.curves import ArcCurve, Array, Curve, LineCurve
from mcserver.motion.pieces import LineBound, LineEdges, Piece, Rows
from mcserver.motion.planner import MotionPlanner
from mcserver.units import AxisType


@dataclass(frozen=True)
class AxisSpec:
    """Limits of one axis in mm or degrees; no jerk: not limited."""

    velocity: float = 200.0
    acceleration: float = 2000.0
    jerk: float | None = None
    rotary: bool = False


def machine_of(axes: Sequence[AxisSpec], *, cycle_hz: float = 1000.0, tolerance_mm: float = 0.0) -> Machine:
    """A machine with these axes, numbered from 0, and ideal drives."""
    text = [
        f'[machine]\nname = "test"\ncycle_hz = {cycle_hz!r}\n[motion]\npath_tolerance_mm = {tolerance_mm!r}'
    ]
    for index, axis in enumerate(axes):
        kind = "rotary" if axis.rotary else "linear"
        text.append(
            f'[[axis]]\nindex = {index}\ntype = "{kind}"\n'
            f"max_velocity = {float(axis.velocity)!r}\nmax_acceleration = {float(axis.acceleration)!r}"
        )
        if axis.jerk is not None:
            text.append(f"max_jerk = {float(axis.jerk)!r}")
        text.append('[axis.drive]\nkind = "ideal"')
    return parse_machine("\n".join(text))


def alike(
    count: int = 2,
    *,
    velocity: float = 200.0,
    acceleration: float = 1000.0,
    jerk: float | None = None,
    cycle_hz: float = 1000.0,
) -> Machine:
    """A machine of ``count`` linear axes with the same limits [mm, s]."""
    return machine_of([AxisSpec(velocity, acceleration, jerk)] * count, cycle_hz=cycle_hz)


@dataclass(frozen=True)
class Move:
    """A feed group with how it joins what is before it."""

    group: FeedGroup
    from_rest: bool = False
    tolerance: float = 0.0


# ---------------------------------------------------------------------- programmed moves


def line_curve(
    machine: Machine, axes: Sequence[int], start: Sequence[float], end: Sequence[float]
) -> LineCurve:
    """A line whose length follows D-30: over its linear axes, else over the rotary ones."""
    linear = [axes[i] for i in range(len(axes)) if machine.axes[axes[i]].type is AxisType.LINEAR]
    counted = linear or list(axes)
    length = math.sqrt(sum((end[list(axes).index(a)] - start[list(axes).index(a)]) ** 2 for a in counted))
    return LineCurve(tuple(axes), tuple(float(x) for x in start), tuple(float(x) for x in end), length)


def arc_curve(
    start: Sequence[float],
    centre: tuple[float, float],
    sweep: float,
    *,
    axes: Sequence[int] = (0, 1),
    further: Sequence[float] = (),
    growth: float = 0.0,
) -> ArcCurve:
    """An arc or helix from ``start`` (plane first); ``further`` is the travel of the other axes."""
    angle = math.atan2(start[1] - centre[1], start[0] - centre[0]) + sweep
    radius = math.hypot(start[0] - centre[0], start[1] - centre[1])
    end_radius = radius + growth
    end = [centre[0] + end_radius * math.cos(angle), centre[1] + end_radius * math.sin(angle)]
    end += [a + b for a, b in zip(start[2:], further, strict=True)]
    length = math.hypot(abs(sweep) * (radius + end_radius) / 2.0, growth, *further)
    return ArcCurve(
        tuple(axes),
        tuple(float(x) for x in start),
        tuple(end),
        (float(centre[0]), float(centre[1])),
        sweep,
        length,
    )


def at_speed(speed: float, *curves: Curve) -> FeedGroup:
    """A G94 group: ``speed`` in m/s or rad/s of the first curve."""
    length = curves[0].length
    return FeedGroup(tuple(curves), requested=length / speed, speed=speed)


def in_time(duration: float, *curves: Curve) -> FeedGroup:
    """A G93 group that lasts ``duration`` [s]."""
    return FeedGroup(tuple(curves), requested=duration, duration=duration)


def polyline(machine: Machine, points: Iterable[Sequence[float]], speed: float) -> list[FeedGroup]:
    """G94 lines over the first axes from point to point [m]."""
    listed = [tuple(float(x) for x in point) for point in points]
    axes = range(len(listed[0]))
    return [at_speed(speed, line_curve(machine, tuple(axes), a, b)) for a, b in pairwise(listed)]


# ---------------------------------------------------------------------- what the planner makes of them


@dataclass
class Motion:
    """All output of a planner.

    Attributes:
        machine, moves: what was asked.
        start: positions before the motion, shape (K,).
        position, velocity: rows u = 1, 2, … of the output, shape (N, K).
        row_line: shape (N,).
        starts, ends: u of each line's marks [cycles], by line number from 1.
        pieces: everything in order of output.
    """

    machine: Machine
    moves: list[Move]
    start: Array
    position: Array
    velocity: Array
    row_line: Array
    row_mask: Array
    starts: dict[int, float]
    ends: dict[int, float]
    pieces: list[Piece]
    bounds: dict[int, LineBound] = field(default_factory=dict)

    @property
    def cycle(self) -> float:
        return self.machine.cycle_s

    def took(self, line: int) -> float:
        """Time between a line's marks [s]."""
        return (self.ends[line] - self.starts[line]) * self.cycle

    @property
    def duration(self) -> float:
        """From the first line's start to the last one's end [s]."""
        return (max(self.ends.values()) - min(self.starts.values())) * self.cycle

    @property
    def rested(self) -> Array:
        """Rows with three rows of rest before and after, shape (N + 6, K)."""
        before = np.tile(self.start, (3, 1))
        after = np.tile(self.position[-1], (3, 1))
        return np.concatenate([before, self.position, after])


@dataclass(frozen=True)
class Commit:
    """After this many appended moves: commit up to ``ahead`` cycles beyond what is committed, or close."""

    after: int
    ahead: float = math.inf
    close: bool = False


def plan(
    machine: Machine,
    moves: Sequence[Move | FeedGroup],
    *,
    start: Array | None = None,
    commits: Sequence[Commit] = (),
    dynamics: JointDynamics | None = None,
) -> Motion:
    """Runs moves through a planner, numbering lines from 1; closes at the end."""
    listed = [move if isinstance(move, Move) else Move(move) for move in moves]
    origin = np.zeros(len(machine.axes)) if start is None else start
    planner = MotionPlanner(machine, origin, dynamics)
    pieces: list[Piece] = []
    for number, move in enumerate(listed, start=1):
        segment = planner.segment(move.group, number)
        assert segment.travels
        planner.append(segment, from_rest=move.from_rest, tolerance=move.tolerance)
        for commit in commits:
            if commit.after == number:
                made = planner.close() if commit.close else planner.commit(planner.u + commit.ahead)
                pieces += made or ()
    pieces += planner.close()
    return collect(machine, listed, origin, pieces)


def edges_of(pieces: list[Piece]) -> list[tuple[float, int, bool]]:
    """Where lines begin and end in a planner's output: u, the line, and whether it ends."""
    return [
        edge
        for piece in pieces
        if isinstance(piece, LineEdges)
        for edge in zip(piece.u.tolist(), piece.line.tolist(), piece.ends.tolist(), strict=True)
    ]


def rows_of(pieces: list[Piece]) -> list[Rows]:
    """Return the blocks of rows; asserts that they follow each other without a gap."""
    rows = [piece for piece in pieces if isinstance(piece, Rows)]
    following = 1
    for block in rows:
        assert block.first == following
        following += len(block.position)
    return rows


def collect(machine: Machine, moves: list[Move], start: Array, pieces: list[Piece]) -> Motion:
    """Rows and marks out of a planner's output."""
    rows = rows_of(pieces)
    edges = edges_of(pieces)
    return Motion(
        machine=machine,
        moves=moves,
        start=start,
        position=np.concatenate([block.position for block in rows]),
        velocity=np.concatenate([block.velocity for block in rows]),
        row_line=np.concatenate([block.line for block in rows]),
        row_mask=np.concatenate([block.axes for block in rows]),
        starts={line: u for u, line, ends in edges if not ends},
        ends={line: u for u, line, ends in edges if ends},
        pieces=pieces,
        bounds={piece.line: piece for piece in pieces if isinstance(piece, LineBound)},
    )
