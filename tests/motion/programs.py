"""Hypothesis strategies: machines with 2 to 12 axes; programs of lines, arcs, helices and concatenations."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.curves import Array, Curve
from tests.motion.measure import tangent
from tests.motion.support import AxisSpec, Commit, Move, arc_curve, at_speed, in_time, line_curve, machine_of

VELOCITIES = (50.0, 200.0, 1000.0)
ACCELERATIONS = (500.0, 2000.0, 20000.0)
JERKS = (None, 20_000.0, 200_000.0, 2_000_000.0)
# Segment lengths [m or rad]: 0.01 mm to 1 m.
LENGTHS = (1e-5, 5e-5, 1e-3, 0.02, 0.1, 1.0)
# Longest that one line is asked to last [s]: what bounds a test's run time.
LONGEST = 1.5


@dataclass(frozen=True)
class Program:
    """What a law is tried on."""

    machine: Machine
    moves: tuple[Move, ...]
    commits: tuple[Commit, ...]


def axis_specs(
    *, rotary: st.SearchStrategy[bool], jerks: tuple[float | None, ...]
) -> st.SearchStrategy[AxisSpec]:
    return st.builds(
        AxisSpec,
        velocity=st.sampled_from(VELOCITIES),
        acceleration=st.sampled_from(ACCELERATIONS),
        jerk=st.sampled_from(jerks),
        rotary=rotary,
    )


@st.composite
def machines(draw: st.DrawFn, jerks: tuple[float | None, ...] = JERKS) -> Machine:
    """2 to 12 axes, the first two or three linear, the others of either kind."""
    linear = draw(st.integers(2, 3))
    others = draw(st.integers(0, 9))
    specs = [draw(axis_specs(rotary=st.just(False), jerks=jerks)) for _ in range(linear)]
    specs += [draw(axis_specs(rotary=st.booleans(), jerks=jerks)) for _ in range(others)]
    return machine_of(specs)


class _Builder:
    """Draws one move after the other, each from where the last one ended."""

    def __init__(self, draw: st.DrawFn, machine: Machine) -> None:
        self.draw = draw
        self.machine = machine
        self.position: Array = np.zeros(len(machine.axes))
        self.moves: list[Move] = []
        self.linear = [axis.index for axis in machine.axes if axis.type.unit == "mm"]

    def add(self, curves: list[Curve], from_rest: bool, tolerance: float) -> None:
        group = self._timed(curves)
        for curve in curves:
            self.position[list(curve.axes)] = curve.position(np.array([1.0]))[0]
        self.moves.append(Move(group, from_rest, tolerance))

    def _timed(self, curves: list[Curve]) -> FeedGroup:
        """A G93 or G94 speed near what the axes can do."""
        draw, first = self.draw, curves[0]
        share = draw(st.sampled_from([0.05, 0.3, 0.9, 1.5]))
        fastest = min(self.machine.axes[axis].max_velocity for axis in first.axes)
        types = {self.machine.axes[axis].type for axis in first.axes}
        by_path = len(types) == 1 and (
            len(first.axes) == 1 if first.axes[0] not in self.linear else len(first.axes) <= 3
        )
        lasting = first.length / (share * fastest)
        if by_path and draw(st.booleans()):
            return at_speed(first.length / min(lasting, LONGEST), *curves)
        return in_time(min(max(lasting, 2e-3), LONGEST), *curves)

    def line(self) -> list[Curve]:
        draw = self.draw
        axes = draw(
            st.lists(st.sampled_from(range(len(self.machine.axes))), min_size=1, max_size=4, unique=True)
        )
        return [self._line(axes, draw(st.sampled_from(LENGTHS)))]

    def _line(self, axes: list[int], length: float) -> Curve:
        draw = self.draw
        signs = st.sampled_from([1.0, -1.0, 0.37, -0.0213])
        parts = [draw(signs) for _ in axes]
        start = self.position[axes]
        return line_curve(self.machine, axes, start.tolist(), (start + length * np.array(parts)).tolist())

    def onward(self) -> list[Curve]:
        """A line in the direction of the move before, or one that turns away from it by a small angle."""
        if not self.moves:
            return self.line()
        before = tangent(self.machine, self.moves[-1].group, 1.0)
        axes = [int(axis) for axis in np.nonzero(before)[0]]
        direction = before[axes]
        if len(axes) > 1:
            angle = self.draw(st.sampled_from([0.0, 1e-4, 0.02, 0.3]))
            a, b = direction[0], direction[1]
            direction[0], direction[1] = (
                a * math.cos(angle) - b * math.sin(angle),
                a * math.sin(angle) + b * math.cos(angle),
            )
        length = self.draw(st.sampled_from(LENGTHS[:5]))
        start = self.position[axes]
        return [line_curve(self.machine, axes, start.tolist(), (start + length * direction).tolist())]

    def back(self) -> list[Curve]:
        """The line before, reversed; a line where it is the first."""
        if not self.moves:
            return self.line()
        before = tangent(self.machine, self.moves[-1].group, 1.0)
        axes = [int(axis) for axis in np.nonzero(before)[0]]
        start = self.position[axes]
        length = self.draw(st.sampled_from(LENGTHS[:5]))
        return [line_curve(self.machine, axes, start.tolist(), (start - length * before[axes]).tolist())]

    def arc(self) -> list[Curve]:
        """An arc or helix; where the move before ends in the arc's plane, perhaps tangent to it."""
        draw = self.draw
        plane = draw(st.permutations(self.linear[:3]))[:2]
        radius = draw(st.sampled_from([1e-4, 1e-3, 0.02, 0.2]))
        sweep = draw(st.sampled_from([0.1, math.pi / 2, -math.pi, 2.0 * math.pi, -5.0 * math.pi]))
        start = self.position[plane]
        angle = draw(st.sampled_from([0.0, 1.0, 2.5, -2.0]))
        if self.moves and draw(st.booleans()):
            along = tangent(self.machine, self.moves[-1].group, 1.0)[plane]
            if np.linalg.norm(along) > 0.5:
                # the centre stands at a right angle to the way here, on the side of the turn
                angle = math.atan2(along[1], along[0]) + math.copysign(math.pi / 2, sweep)
        centre = (start[0] + radius * math.cos(angle), start[1] + radius * math.sin(angle))
        axes, begin, further = list(plane), start.tolist(), []
        rising = [axis for axis in self.linear if axis not in plane]
        if rising and draw(st.booleans()):
            axes.append(rising[0])
            begin.append(float(self.position[rising[0]]))
            further.append(draw(st.sampled_from([1e-3, -0.05])))
        return [arc_curve(begin, centre, sweep, axes=axes, further=further)]

    def joined(self) -> list[Curve]:
        """A concatenation: an arc or line, and a line of other axes with it."""
        curves = self.draw(st.sampled_from([self.arc, self.line]))()
        free = [axis for axis in range(len(self.machine.axes)) if axis not in curves[0].axes]
        if free:
            axes = self.draw(st.lists(st.sampled_from(free), min_size=1, max_size=3, unique=True))
            curves.append(self._line(axes, self.draw(st.sampled_from(LENGTHS[2:5]))))
        return curves


@st.composite
def programs(
    draw: st.DrawFn,
    *,
    kinds: tuple[str, ...] = ("line", "onward", "back", "arc", "joined"),
    tolerances: tuple[float, ...] = (0.0,),
    jerks: tuple[float | None, ...] = JERKS,
    longest: int = 7,
) -> Program:
    """A machine, 1 to ``longest`` moves and a pattern of commits."""
    machine = draw(machines(jerks))
    builder = _Builder(draw, machine)
    tolerance = draw(st.sampled_from(tolerances))
    for _ in range(draw(st.integers(1, longest))):
        curves = getattr(builder, draw(st.sampled_from(kinds)))()
        builder.add(curves, draw(st.integers(0, 5)) == 0, tolerance)
    return Program(machine, tuple(builder.moves), draw(commit_patterns(len(builder.moves))))


def commit_patterns(count: int) -> st.SearchStrategy[tuple[Commit, ...]]:
    """When the planner has to hand over, and how much."""
    commit = st.builds(
        Commit,
        after=st.integers(1, count),
        ahead=st.sampled_from([1.0, 7.5, 150.0, 1000.0, math.inf]),
        close=st.sampled_from([False, False, False, True]),
    )
    return st.lists(commit, max_size=6).map(tuple)
