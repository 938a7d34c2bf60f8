"""Program times against the time-optimal bound: TOPP-RA on the same path under the same limits.

The machines have no jerk limit, since the bound knows none. A path that stops is bounded piece by piece.
"""

from __future__ import annotations

import math
import statistics
import sys
from collections.abc import Callable

import numpy as np
import pytest

from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.curves import ArcCurve, Curve
from tests.motion.support import Move, alike, arc_curve, at_speed, line_curve, plan, polyline

ta = pytest.importorskip("toppra")

FAST = 10.0
# Median of our time over the bound.
GOAL = 1.10
# No program is to be much slower than the bound either.
WORST = 1.35


class _Chain(ta.interpolator.AbstractGeometricPath):  # type: ignore[misc]
    """Tangent curves as one path over a common coordinate in which the tangent's length is continuous."""

    def __init__(self, curves: list[Curve]) -> None:
        self._curves = curves
        self._lengths = [float(np.linalg.norm(curve.derivatives(np.array([0.0]))[0][0])) for curve in curves]
        self._edges = np.concatenate([[0.0], np.cumsum(self._lengths)])

    @property
    def dof(self) -> int:
        return len(self._curves[0].axes)

    @property
    def path_interval(self) -> np.ndarray:
        return np.array([0.0, self._edges[-1]])

    def __call__(self, positions: object, order: int = 0) -> np.ndarray:
        scalar = np.ndim(positions) == 0  # type: ignore[arg-type]
        path = np.atleast_1d(np.asarray(positions, dtype=float))
        which = np.clip(np.searchsorted(self._edges, path, side="right") - 1, 0, len(self._curves) - 1)
        result = np.empty((len(path), self.dof))
        for index, (curve, length) in enumerate(zip(self._curves, self._lengths, strict=True)):
            inside = which == index
            if inside.any():
                s = np.clip((path[inside] - self._edges[index]) / length, 0.0, 1.0)
                value = curve.position(s) if order == 0 else curve.derivatives(s)[order - 1] / length**order
                result[inside] = value
        return result[0] if scalar else result


def bound(machine: Machine, groups: list[FeedGroup], *, grid: int = 400) -> float:
    """Least time of tangent groups from rest to rest under velocity, acceleration and F [s]."""
    chain = _Chain([group.curves[0] for group in groups])
    velocity = np.array([axis.max_velocity for axis in machine.axes])
    acceleration = np.array([axis.max_acceleration for axis in machine.axes])
    limits = [
        ta.constraint.JointVelocityConstraint(np.stack([-velocity, velocity]).T),
        ta.constraint.JointAccelerationConstraint(
            np.stack([-acceleration, acceleration]).T, ta.constraint.DiscretizationType.Interpolation
        ),
    ]
    feed = groups[0].speed
    assert feed is not None
    assert all(group.speed == feed for group in groups)
    if feed < FAST:
        # |dq/ds| is 1 along all of these paths: F is a limit of the path's own speed
        limits.append(
            ta.constraint.JointVelocityConstraintVarying(
                lambda s: np.stack([-feed * np.abs(chain(s, 1)) - 1e-9, feed * np.abs(chain(s, 1)) + 1e-9]).T
            )
        )
    points = np.linspace(0.0, chain.path_interval[1], grid + 1)
    solver = ta.algorithm.TOPPRA(limits, chain, gridpoints=points, solver_wrapper="seidel")
    _, speeds, _ = solver.compute_parameterization(0.0, 0.0)
    assert speeds is not None
    return float((2.0 * np.diff(points) / (speeds[1:] + speeds[:-1])).sum())


def bound_with_stops(machine: Machine, groups: list[FeedGroup]) -> float:
    return sum(bound(machine, [group], grid=200) for group in groups)


def tangent_arc(before: Curve, sweep: float, radius: float, speed: float) -> FeedGroup:
    """An arc in the plane of the first two axes that goes on in the direction in which ``before`` ends."""
    end = before.position(np.array([1.0]))[0]
    along = before.derivatives(np.array([1.0]))[0][0]
    angle = math.atan2(along[1], along[0]) + math.copysign(math.pi / 2.0, sweep)
    centre = (end[0] + radius * math.cos(angle), end[1] + radius * math.sin(angle))
    return at_speed(speed, arc_curve(end.tolist(), centre, sweep))


def tangent_line(machine: Machine, before: Curve, length: float, speed: float) -> FeedGroup:
    end = before.position(np.array([1.0]))[0]
    along = before.derivatives(np.array([1.0]))[0][0]
    goal = end + length * along / np.linalg.norm(along)
    return at_speed(speed, line_curve(machine, before.axes, end.tolist(), goal.tolist()))


def chain(machine: Machine, speed: float, *steps: tuple[float, float]) -> list[FeedGroup]:
    """Lines (0, length) and arcs (sweep, radius), each tangent to the one before."""
    groups = [at_speed(speed, line_curve(machine, (0, 1), (0.0, 0.0), (steps[0][1], 0.0)))]
    for sweep, size in steps[1:]:
        last = groups[-1].curves[0]
        groups.append(
            tangent_line(machine, last, size, speed)
            if sweep == 0.0
            else tangent_arc(last, sweep, size, speed)
        )
    return groups


MACHINE = alike(2, velocity=500.0, acceleration=2000.0)
SPACE = alike(3, velocity=500.0, acceleration=2000.0)
QUARTER = math.pi / 2.0


def circle(radius: float, sweep: float = 2.0 * math.pi, speed: float = FAST) -> list[FeedGroup]:
    return [at_speed(speed, arc_curve((0.0, 0.0), (radius, 0.0), sweep))]


def helix(radius: float, turns: float, rise: float, speed: float = FAST) -> list[FeedGroup]:
    curve: ArcCurve = arc_curve(
        (0.0, 0.0, 0.0), (radius, 0.0), 2.0 * math.pi * turns, axes=(0, 1, 2), further=(rise,)
    )
    return [at_speed(speed, curve)]


def regular(count: int, radius: float, speed: float) -> list[FeedGroup]:
    turns = np.linspace(0.0, 2.0 * math.pi, count + 1)
    return polyline(MACHINE, zip(radius * np.cos(turns), radius * np.sin(turns), strict=True), speed)


SLOT = ((0.0, 0.1), (math.pi, 0.02), (0.0, 0.1), (math.pi, 0.02))
ESS = ((0.0, 0.05), (QUARTER, 0.03), (-QUARTER, 0.03), (0.0, 0.05))
ROUNDED_SQUARE = (
    (0.0, 0.08),
    (QUARTER, 0.01),
    (0.0, 0.08),
    (QUARTER, 0.01),
    (0.0, 0.08),
    (QUARTER, 0.01),
    (0.0, 0.08),
)

# name, machine, groups, whether each group ends with a stop
PROGRAMS: list[tuple[str, Machine, Callable[[], list[FeedGroup]], bool]] = [
    ("line", MACHINE, lambda: polyline(MACHINE, [(0, 0), (0.3, 0.1)], FAST), False),
    ("short line", MACHINE, lambda: polyline(MACHINE, [(0, 0), (0.001, 0.0005)], FAST), False),
    ("slow line", MACHINE, lambda: polyline(MACHINE, [(0, 0), (0.1, 0.1)], 0.05), False),
    ("square with stops", MACHINE, lambda: regular(4, 0.1, FAST), True),
    ("hexagon with stops", MACHINE, lambda: regular(6, 0.05, FAST), True),
    (
        "row of ten lines",
        MACHINE,
        lambda: polyline(MACHINE, [(0.02 * i, 0.01 * i) for i in range(11)], FAST),
        False,
    ),
    (
        "row of 200 lines",
        MACHINE,
        lambda: polyline(MACHINE, [(0.001 * i, 0.0) for i in range(201)], FAST),
        False,
    ),
    ("quarter arc, 100 mm", MACHINE, lambda: circle(0.1, QUARTER), False),
    ("quarter arc, 5 mm", MACHINE, lambda: circle(0.005, QUARTER), False),
    ("short arc, 100 mm", MACHINE, lambda: circle(0.1, 0.1), False),
    ("circle, 10 mm", MACHINE, lambda: circle(0.01), False),
    ("circle, 100 mm", MACHINE, lambda: circle(0.1), False),
    ("circle, 1 m", MACHINE, lambda: circle(1.0), False),
    ("five turns, 20 mm", MACHINE, lambda: circle(0.02, 10.0 * math.pi), False),
    ("helix, 20 mm", SPACE, lambda: helix(0.02, 3.0, 0.05), False),
    ("steep helix", SPACE, lambda: helix(0.01, 2.0, 0.4), False),
    ("slot", MACHINE, lambda: chain(MACHINE, FAST, *SLOT), False),
    ("slot at 100 mm/s", MACHINE, lambda: chain(MACHINE, 0.1, *SLOT), False),
    ("S of two arcs", MACHINE, lambda: chain(MACHINE, FAST, *ESS), False),
    ("square with round corners", MACHINE, lambda: chain(MACHINE, FAST, *ROUNDED_SQUARE), False),
]


def ratio(machine: Machine, groups: list[FeedGroup], stops: bool) -> tuple[float, float]:
    """Our duration and the bound [s]."""
    motion = plan(machine, [Move(group, from_rest=stops) for group in groups])
    least = bound_with_stops(machine, groups) if stops else bound(machine, groups)
    return motion.duration, least


def test_program_times_are_near_the_time_optimal_bound(capsys: pytest.CaptureFixture[str]) -> None:
    found = {name: ratio(machine, make(), stops) for name, machine, make, stops in PROGRAMS}
    ratios = {name: ours / least for name, (ours, least) in found.items()}
    table = [
        f"{name:28s} {ours:9.4f} s   bound {least:9.4f} s   ratio {ours / least:6.3f}"
        for name, (ours, least) in found.items()
    ]
    with capsys.disabled():
        sys.stdout.write(
            "\n".join(["", *table, f"{'median':28s} {statistics.median(ratios.values()):40.3f}", ""])
        )
    assert min(ratios.values()) >= 0.999
    assert statistics.median(ratios.values()) <= GOAL
    assert max(ratios.values()) <= WORST
