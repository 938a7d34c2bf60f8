"""What a planner's rows do, judged from outside: differences at the cycle rate (D-36), distance from a path.

Nothing here uses the planner's own arithmetic.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.curves import ArcCurve, Array, LineCurve
from mcserver.units import MM, AxisType
from tests.motion.support import Motion, Move

VELOCITY_SLACK = 1.001
ACCELERATION_SLACK = 1.01
JERK_SLACK = 1.05
# A joint's tangents that differ by less are one tangent.
SAME_DIRECTION = 1e-9


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
    """Greatest third difference over the limit, leaving out three rows about each u in ``vertices``."""
    limit = np.array([axis.max_jerk for axis in motion.machine.axes])
    ratio = np.abs(np.diff(motion.rested, 3, axis=0)) / motion.cycle**3 / limit
    # rested[i] is row u = i - 2; the third difference k spans rows u = k - 2 … k + 1
    centre = np.arange(len(ratio)) - 0.5
    for u in vertices:
        ratio[np.abs(centre - u) <= 3.0] = 0.0
    return float(ratio.max())


def jerk_of_vertices(motion: Motion, vertices: Sequence[int], phases: int = 32) -> float:
    """Greatest third difference over the limit of the path itself, wherever the cycles fall.

    Rows and vertices are joined by straight lines, which does no more than the rows where there is no vertex.

    Args:
        vertices: numbers of the lines that begin at one, on an exact path.
    """
    rows = motion.rested
    where, points = np.arange(len(rows)) - 2.0, rows
    starts = list(bases(motion))
    if vertices:
        where = np.append(where, [motion.starts[number] for number in vertices])
        points = np.concatenate([rows, [starts[number - 1] for number in vertices]])
    order = np.argsort(where, kind="stable")
    limit = np.array([axis.max_jerk for axis in motion.machine.axes])
    worst = 0.0
    for phase in np.linspace(0.0, 1.0, phases, endpoint=False):
        at = np.arange(len(rows)) - 2.0 + phase
        path = np.stack([np.interp(at, where[order], column[order]) for column in points.T], axis=1)
        worst = max(worst, float((np.abs(np.diff(path, 3, axis=0)) / motion.cycle**3 / limit).max()))
    return worst


def exact_vertices(motion: Motion) -> list[int]:
    """Return the numbers of the lines that begin with a step of the tangent on an exact path."""
    return [
        number
        for number, (before, after) in enumerate(itertools.pairwise(motion.moves), start=2)
        if not after.tolerance and turn(motion.machine, before.group, after.group) > SAME_DIRECTION
    ]


def vertices_of(motion: Motion, *, tolerance: float = math.inf) -> list[float]:
    """Return the u at which lines meet with a step of the tangent (D-36), those with no more tolerance."""
    return [
        motion.starts[number]
        for number, (before, after) in enumerate(
            zip(motion.moves[:-1], motion.moves[1:], strict=True), start=2
        )
        if after.tolerance <= tolerance and turn(motion.machine, before.group, after.group) > SAME_DIRECTION
    ]


def turn(machine: Machine, before: FeedGroup, after: FeedGroup) -> float:
    """Length of the difference of the unit tangents where two groups meet."""
    return float(np.linalg.norm(tangent(machine, after, 0.0) - tangent(machine, before, 1.0)))


def tangent(machine: Machine, group: FeedGroup, s: float) -> Array:
    """Unit tangent over the machine's axes at one end of a group, shape (K,)."""
    slope = np.zeros(len(machine.axes))
    for curve in group.curves:
        slope[[machine.column_of(axis) for axis in curve.axes]] = curve.derivatives(np.array([s]))[0][0]
    result: Array = slope / np.linalg.norm(slope)
    return result


def end_of(machine: Machine, moves: Sequence[Move], start: Array) -> Array:
    """Where the programmed path ends, shape (K,)."""
    position = start.copy()
    for move in moves:
        for curve in move.group.curves:
            position[[machine.column_of(axis) for axis in curve.axes]] = curve.position(np.array([1.0]))[0]
    return position


def bases(motion: Motion) -> Iterator[Array]:
    """Positions before each move, shape (K,) each."""
    at = motion.start
    for move in motion.moves:
        yield at
        at = end_of(motion.machine, [move], at)


def group_position(machine: Machine, group: FeedGroup, base: Array, s: Array) -> Array:
    """All columns along a group, shape (len(s), K); other columns rest at ``base``."""
    points = np.tile(base, (len(s), 1))
    for curve in group.curves:
        points[:, [machine.column_of(axis) for axis in curve.axes]] = curve.position(s)
    return points


def group_slope(machine: Machine, group: FeedGroup, s: Array) -> Array:
    slope = np.zeros((len(s), len(machine.axes)))
    for curve in group.curves:
        slope[:, [machine.column_of(axis) for axis in curve.axes]] = curve.derivatives(s)[0]
    return slope


def weights_of(machine: Machine) -> Array:
    """What each axis weighs in a distance from the path, shape (K,)."""
    return np.array([MM / axis.type.si_per_unit for axis in machine.axes])


def bow_of(motion: Motion) -> float:
    """Return how far a path may bow between two rows, as `weights_of` counts."""
    most = np.array([axis.max_acceleration for axis in motion.machine.axes])
    fastest = float((most * weights_of(motion.machine)).max())
    return math.sqrt(len(most)) * fastest * motion.cycle**2 / 4.0


# Of the share of a path at which the search for its nearest point ends.
SETTLED = 1e-13


def away_from(machine: Machine, group: FeedGroup, base: Array, points: Array) -> Array:
    """Distance of points (n, K) from a group's path, shape (n,); a degree counts as a millimetre.

    The nearest s by Gauss-Newton from the nearest sample of each half turn: turns of a helix, or the two ends
    of one, lie close together.
    """
    sweep = max((abs(curve.sweep) for curve in group.curves if isinstance(curve, ArcCurve)), default=0.0)
    turns = max(1, math.ceil(sweep / math.pi))
    count = 2 + int(16 * sweep / turns)
    weights = weights_of(machine)
    points = points * weights
    best = np.full(len(points), math.inf)
    for which in range(turns):
        # not the ends: a point just before the start of one turn lies on the turn before it
        grid = (which + (np.arange(count) + 0.5) / count) / turns
        path = group_position(machine, group, base, grid) * weights
        # squared distances up to a constant of each point
        nearness = (path * path).sum(axis=1) - 2.0 * points @ path.T
        nearest = grid[np.argmin(nearness, axis=1)]
        for _ in range(8):
            gap = points - group_position(machine, group, base, nearest) * weights
            best = np.minimum(best, np.linalg.norm(gap, axis=1))
            slope = group_slope(machine, group, nearest) * weights
            step = (gap * slope).sum(axis=1) / np.maximum((slope * slope).sum(axis=1), 1e-300)
            nearest, before = np.clip(nearest + step, 0.0, 1.0), nearest
            if np.abs(nearest - before).max() < SETTLED:
                break
    return best


def farthest_from_path(motion: Motion) -> float:
    """Greatest distance of a row from the path of its own line or of a neighbour [m or rad]."""
    return float(from_path_by_line(motion).max())


def from_path_by_line(motion: Motion) -> Array:
    """Return `farthest_from_path` of the rows of each line, shape (n,)."""
    worst = np.zeros(len(motion.moves))
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
        worst[number - 1] = distance.max()
    return worst


def path_missed_by(motion: Motion) -> float:
    """Greatest distance of a programmed point from the polyline of the rows [m or rad]."""
    return float(path_missed_by_line(motion).max())


def path_missed_by_line(motion: Motion, points_a_line: int = 33) -> Array:
    """Return `path_missed_by` of each line, shape (n,)."""
    polyline = np.concatenate([motion.start[None, :], motion.position])
    weights = weights_of(motion.machine)
    worst = np.zeros(len(motion.moves))
    for move, base, number in zip(motion.moves, bases(motion), range(1, len(motion.moves) + 1), strict=True):
        # a corner in time begins on the line before, by its half at the most
        before = 0.5 * (motion.starts[max(number - 1, 1)] + motion.starts[number])
        low = max(0, math.floor(min(before, motion.starts[number] - 2.0)))
        high = min(len(polyline), math.ceil(motion.ends[number]) + 3)
        near = polyline[low:high] * weights
        s = np.concatenate([np.linspace(0.0, 1.0, points_a_line), 10.0 ** -np.arange(1.0, 5.0)])
        programmed = group_position(motion.machine, move.group, base, s) * weights
        worst[number - 1] = from_polyline(programmed, near)
    return worst


def from_polyline(points: Array, nodes: Array) -> float:
    """Return the greatest distance of points (n, K) from the polyline through nodes (m, K)."""
    travel = np.diff(nodes, axis=0)
    length = np.maximum((travel * travel).sum(axis=1), 1e-300)
    # column by column: one array of points, segments and columns would not stay in the processor's cache
    away = [point[:, None] - node[None, :-1] for point, node in zip(points.T, nodes.T, strict=True)]
    along = sum(each * step for each, step in zip(away, travel.T, strict=True))
    along = np.clip(along / length, 0.0, 1.0)
    gap = sum((each - along * step) ** 2 for each, step in zip(away, travel.T, strict=True))
    return float(np.sqrt(np.min(gap, axis=1).max()))


def speed_over_feed(motion: Motion) -> float:
    """Greatest path speed (D-30) of rows within one G94 line over its F."""
    worst = 0.0
    rows = np.concatenate([motion.start[None, :], motion.position])
    for number, move in enumerate(motion.moves, start=1):
        group = move.group
        if group.speed is None:
            continue
        curve = group.curves[group.reference]
        linear = [
            a for a in curve.axes if motion.machine.axes[motion.machine.column_of(a)].type is AxisType.LINEAR
        ]
        columns = [motion.machine.column_of(axis) for axis in (linear or curve.axes)]
        low, high = math.ceil(motion.starts[number]), math.floor(motion.ends[number])
        inside = rows[low : high + 1, columns]
        if len(inside) > 1:
            speed = np.linalg.norm(np.diff(inside, axis=0), axis=1) / motion.cycle
            worst = max(worst, float(speed.max()) / group.speed)
    return worst


def assert_kept(motion: Motion, tolerance: float) -> None:
    """Every limit at every cycle, vertices included, F, and the tolerance in both directions [m]."""
    axes = motion.machine.axes
    assert velocity_ratio(motion) <= VELOCITY_SLACK
    assert row_velocity_ratio(motion) <= VELOCITY_SLACK
    assert acceleration_ratio(motion) <= ACCELERATION_SLACK
    if all(math.isfinite(axis.max_jerk) for axis in axes):
        assert jerk_ratio(motion) <= JERK_SLACK
    assert speed_over_feed(motion) <= VELOCITY_SLACK
    assert farthest_from_path(motion) <= tolerance
    # between two rows the path bows
    fastest = max(axis.max_acceleration for axis in axes if axis.type is AxisType.LINEAR)
    assert path_missed_by(motion) <= tolerance + fastest * motion.cycle**2 / 4.0


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
                limits = machine.axes[machine.column_of(axis)]
                velocity = min(velocity, limits.max_velocity / abs(b - a))
                acceleration = min(acceleration, limits.max_acceleration / abs(b - a))
                jerk = min(jerk, limits.max_jerk / abs(b - a))
    return rest_to_rest(1.0, velocity, acceleration, jerk)
