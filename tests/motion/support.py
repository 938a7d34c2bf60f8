"""Machines, moves and measurements for the laws of motion: what a planner's rows do, judged from outside.

Nothing here uses the planner's own arithmetic: rows are differenced at the cycle rate (D-36) and compared with
the programmed curves and the machine's limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from mcserver.config import Machine, parse_machine
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.path import ArcCurve, Array, Curve, LineCurve
from mcserver.motion.planner import LineBound, LineMark, MotionPlanner, Piece
from mcserver.motion.sampling import Rows
from mcserver.units import AxisType

VELOCITY_SLACK = 1.001
ACCELERATION_SLACK = 1.01
JERK_SLACK = 1.05
# A joint's tangents that differ by less are one tangent.
SAME_DIRECTION = 1e-9


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


def line_curve(machine: Machine, axes: Sequence[int], start: Sequence[float], end: Sequence[float]) -> LineCurve:
    """A line whose length follows D-30: the root of the sum of squares over linear axes, else over rotary ones."""
    linear = [axes[i] for i in range(len(axes)) if machine.axes[axes[i]].type is AxisType.LINEAR]
    counted = linear or list(axes)
    length = math.sqrt(sum((end[list(axes).index(a)] - start[list(axes).index(a)]) ** 2 for a in counted))
    return LineCurve(
        tuple(axes), tuple(float(x) for x in start), tuple(float(x) for x in end), length
    )


def arc_curve(
    start: Sequence[float],
    centre: tuple[float, float],
    sweep: float,
    *,
    axes: Sequence[int] = (0, 1),
    further: Sequence[float] = (),
    growth: float = 0.0,
) -> ArcCurve:
    """An arc or helix from ``start`` (plane first) about ``centre``; ``further`` is the travel of the other axes."""
    angle = math.atan2(start[1] - centre[1], start[0] - centre[0]) + sweep
    radius = math.hypot(start[0] - centre[0], start[1] - centre[1])
    end_radius = radius + growth
    end = [centre[0] + end_radius * math.cos(angle), centre[1] + end_radius * math.sin(angle)]
    end += [a + b for a, b in zip(start[2:], further, strict=True)]
    length = math.hypot(abs(sweep) * (radius + end_radius) / 2.0, *further)
    return ArcCurve(
        tuple(axes), tuple(float(x) for x in start), tuple(end), (float(centre[0]), float(centre[1])), sweep, length
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
    return [
        at_speed(speed, line_curve(machine, tuple(axes), a, b))
        for a, b in zip(listed[:-1], listed[1:], strict=True)
    ]


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
) -> Motion:
    """Runs moves through a planner, numbering lines from 1; closes at the end."""
    listed = [move if isinstance(move, Move) else Move(move) for move in moves]
    origin = np.zeros(len(machine.axes)) if start is None else start
    planner = MotionPlanner(machine, origin)
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


def collect(machine: Machine, moves: list[Move], start: Array, pieces: list[Piece]) -> Motion:
    """Rows and marks out of a planner's output; asserts that rows follow each other without a gap."""
    rows = [piece for piece in pieces if isinstance(piece, Rows)]
    following = 1
    for block in rows:
        assert block.first == following
        following += len(block.position)
    marks = [piece for piece in pieces if isinstance(piece, LineMark)]
    return Motion(
        machine=machine,
        moves=moves,
        start=start,
        position=np.concatenate([block.position for block in rows]),
        velocity=np.concatenate([block.velocity for block in rows]),
        row_line=np.concatenate([block.line for block in rows]),
        row_mask=np.concatenate([block.axes for block in rows]),
        starts={mark.line: mark.u for mark in marks if not mark.ends},
        ends={mark.line: mark.u for mark in marks if mark.ends},
        pieces=pieces,
        bounds={piece.line: piece for piece in pieces if isinstance(piece, LineBound)},
    )


# ---------------------------------------------------------------------- measurements


def velocity_ratio(motion: Motion) -> float:
    """Greatest first difference at the cycle rate over the axis's limit."""
    limit = np.array([axis.max_velocity for axis in motion.machine.axes])
    return float((np.abs(np.diff(motion.rested, axis=0)) / motion.cycle / limit).max())


def row_velocity_ratio(motion: Motion) -> float:
    """Greatest velocity that a row states over the axis's limit."""
    limit = np.array([axis.max_velocity for axis in motion.machine.axes])
    return float((np.abs(motion.velocity) / limit).max())


def acceleration_ratio(motion: Motion) -> float:
    """Greatest second difference at the cycle rate over the axis's limit."""
    limit = np.array([axis.max_acceleration for axis in motion.machine.axes])
    return float((np.abs(np.diff(motion.rested, 2, axis=0)) / motion.cycle**2 / limit).max())


def jerk_ratio(motion: Motion, *, vertices: Sequence[float] = ()) -> float:
    """Greatest third difference over the axis's limit, leaving out three rows about each u in ``vertices``."""
    limit = np.array([axis.max_jerk for axis in motion.machine.axes])
    ratio = np.abs(np.diff(motion.rested, 3, axis=0)) / motion.cycle**3 / limit
    # rested[i] is row u = i - 2; the third difference k spans rows u = k - 2 … k + 1
    centre = np.arange(len(ratio)) - 0.5
    for u in vertices:
        ratio[np.abs(centre - u) <= 3.0] = 0.0
    return float(ratio.max())


def vertices_of(motion: Motion) -> list[float]:
    """The u at which lines meet with a step of the tangent (D-36)."""
    return [
        motion.starts[number]
        for number, (before, after) in enumerate(zip(motion.moves[:-1], motion.moves[1:], strict=True), start=2)
        if turn(motion.machine, before.group, after.group) > SAME_DIRECTION
    ]


def turn(machine: Machine, before: FeedGroup, after: FeedGroup) -> float:
    """Length of the difference of the unit tangents where two groups meet."""
    return float(np.linalg.norm(tangent(machine, after, 0.0) - tangent(machine, before, 1.0)))


def tangent(machine: Machine, group: FeedGroup, s: float) -> Array:
    """Unit tangent over the machine's axes at one end of a group, shape (K,)."""
    slope = np.zeros(len(machine.axes))
    for curve in group.curves:
        slope[[machine.slot(axis) for axis in curve.axes]] = curve.derivatives(np.array([s]))[0][0]
    result: Array = slope / np.linalg.norm(slope)
    return result


def end_of(machine: Machine, moves: Sequence[Move], start: Array) -> Array:
    """Where the programmed path ends, shape (K,)."""
    position = start.copy()
    for move in moves:
        for curve in move.group.curves:
            position[[machine.slot(axis) for axis in curve.axes]] = curve.position(np.array([1.0]))[0]
    return position


def bases(motion: Motion) -> Iterator[Array]:
    """Positions before each move, shape (K,) each."""
    for count in range(len(motion.moves)):
        yield end_of(motion.machine, motion.moves[:count], motion.start)


def group_position(machine: Machine, group: FeedGroup, base: Array, s: Array) -> Array:
    """All columns along a group, shape (len(s), K); other columns rest at ``base``."""
    points = np.tile(base, (len(s), 1))
    for curve in group.curves:
        points[:, [machine.slot(axis) for axis in curve.axes]] = curve.position(s)
    return points


def group_slope(machine: Machine, group: FeedGroup, s: Array) -> Array:
    slope = np.zeros((len(s), len(machine.axes)))
    for curve in group.curves:
        slope[:, [machine.slot(axis) for axis in curve.axes]] = curve.derivatives(s)[0]
    return slope


def away_from(machine: Machine, group: FeedGroup, base: Array, points: Array) -> Array:
    """Distance of points (n, K) from a group's path over all axes, shape (n,).

    The nearest s by Gauss-Newton from the nearest sample of each turn: turns of a helix lie close together.
    """
    sweep = max((abs(curve.sweep) for curve in group.curves if isinstance(curve, ArcCurve)), default=0.0)
    turns = max(1, math.ceil(sweep / (2.0 * math.pi)))
    count = 2 + int(16 * sweep / turns)
    best = np.full(len(points), math.inf)
    for which in range(turns):
        # not the ends: a point just before the start of one turn lies on the turn before it
        grid = (which + (np.arange(count) + 0.5) / count) / turns
        path = group_position(machine, group, base, grid)
        # squared distances up to a constant of each point
        nearness = (path * path).sum(axis=1) - 2.0 * points @ path.T
        nearest = grid[np.argmin(nearness, axis=1)]
        for _ in range(8):
            gap = points - group_position(machine, group, base, nearest)
            best = np.minimum(best, np.linalg.norm(gap, axis=1))
            slope = group_slope(machine, group, nearest)
            step = (gap * slope).sum(axis=1) / np.maximum((slope * slope).sum(axis=1), 1e-300)
            nearest = np.clip(nearest + step, 0.0, 1.0)
    return best


def farthest_from_path(motion: Motion) -> float:
    """Greatest distance of a row from the path of its own line or of a neighbour [m or rad]."""
    worst = 0.0
    based = list(bases(motion))
    for number in range(1, len(motion.moves) + 1):
        points = motion.position[motion.row_line == number]
        if not len(points):
            continue
        distance = np.full(len(points), math.inf)
        for other in (number, number - 1, number + 1):
            unsettled = distance > 1e-9
            if 1 <= other <= len(motion.moves) and unsettled.any():
                group, base = motion.moves[other - 1].group, based[other - 1]
                distance[unsettled] = np.minimum(
                    distance[unsettled], away_from(motion.machine, group, base, points[unsettled])
                )
        worst = max(worst, float(distance.max()))
    return worst


def path_missed_by(motion: Motion, points_a_line: int = 33) -> float:
    """Greatest distance of a programmed point from the polyline of the rows [m or rad]."""
    polyline = np.concatenate([motion.start[None, :], motion.position])
    worst = 0.0
    for move, base, number in zip(motion.moves, bases(motion), range(1, len(motion.moves) + 1), strict=True):
        low = max(0, math.floor(motion.starts[number]) - 2)
        high = min(len(polyline), math.ceil(motion.ends[number]) + 3)
        near = polyline[low:high]
        s = np.concatenate([np.linspace(0.0, 1.0, points_a_line), 10.0 ** -np.arange(1.0, 5.0)])
        programmed = group_position(motion.machine, move.group, base, s)
        worst = max(worst, _from_polyline(programmed, near))
    return worst


def _from_polyline(points: Array, nodes: Array) -> float:
    travel = np.diff(nodes, axis=0)
    length = np.maximum((travel * travel).sum(axis=1), 1e-300)
    away = points[:, None, :] - nodes[None, :-1, :]
    along = np.clip((away * travel).sum(axis=2) / length, 0.0, 1.0)
    gap = away - along[:, :, None] * travel
    return float(np.sqrt((gap * gap).sum(axis=2).min(axis=1).max()))


def speed_over_feed(motion: Motion) -> float:
    """Greatest path speed (D-30) of rows within one G94 line over its F."""
    worst = 0.0
    rows = np.concatenate([motion.start[None, :], motion.position])
    for number, move in enumerate(motion.moves, start=1):
        group = move.group
        if group.speed is None:
            continue
        curve = group.curves[group.reference]
        linear = [a for a in curve.axes if motion.machine.axes[motion.machine.slot(a)].type is AxisType.LINEAR]
        columns = [motion.machine.slot(axis) for axis in (linear or curve.axes)]
        low, high = math.ceil(motion.starts[number]), math.floor(motion.ends[number])
        inside = rows[low : high + 1, columns]
        if len(inside) > 1:
            speed = np.linalg.norm(np.diff(inside, axis=0), axis=1) / motion.cycle
            worst = max(worst, float(speed.max()) / group.speed)
    return worst


def rest_to_rest(distance: float, velocity: float, acceleration: float, jerk: float) -> float:
    """Least time over a distance from rest to rest under three limits, by bisection on the peak speed [s]."""

    def ramp_time(speed: float) -> float:
        if math.isinf(jerk):
            return speed / acceleration
        if speed * jerk >= acceleration**2:
            return speed / acceleration + acceleration / jerk
        return 2.0 * math.sqrt(speed / jerk)

    if velocity * ramp_time(velocity) <= distance:
        return 2.0 * ramp_time(velocity) + (distance - velocity * ramp_time(velocity)) / velocity
    low, high = 0.0, velocity
    for _ in range(200):
        middle = (low + high) / 2.0
        if middle * ramp_time(middle) <= distance:
            low = middle
        else:
            high = middle
    return 2.0 * ramp_time(high)


def least_time(machine: Machine, group: FeedGroup) -> float:
    """Least time of a group of lines from rest to rest under its axes' limits [s]."""
    velocity = acceleration = jerk = math.inf
    for curve in group.curves:
        assert isinstance(curve, LineCurve)
        for axis, a, b in zip(curve.axes, curve.start, curve.end, strict=True):
            if a != b:
                limits = machine.axes[machine.slot(axis)]
                velocity = min(velocity, limits.max_velocity / abs(b - a))
                acceleration = min(acceleration, limits.max_acceleration / abs(b - a))
                jerk = min(jerk, limits.max_jerk / abs(b - a))
    return rest_to_rest(1.0, velocity, acceleration, jerk)
