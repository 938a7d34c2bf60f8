"""Random programs of what the other generator leaves out: machines whose axes have little in common, rotary
axes, every plane, helices, spirals, concatenations, reversals, lines of very different length, F and T.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.curves import Array, Curve
from mcserver.units import AxisType
from tests.motion.measure import tangent
from tests.motion.support import (
    AxisSpec,
    Commit,
    Move,
    arc_curve,
    at_speed,
    in_time,
    line_curve,
    machine_of,
)

# Lengths of lines [m or rad], and F [m/s or rad/s]: 1 to a million mm/min.
LENGTHS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 5e-3, 0.05, 0.5, 10.0)
FEEDS = (1e3 / 6e7, 1e-3, 0.02, 0.1, 0.5, 2.0, 1e6 / 6e4)
# How far directions turn from line to line [rad].
TURNS = (0.0, 1e-9, 1e-6, 1e-3, 0.05, 0.3, 1.0, math.pi / 2)
TOLERANCES = (0.0, 1e-6, 1e-5, 5e-5, 5e-4, 2e-3)
# Longest that one line may ask for, and all of them [s]: what bounds a run.
LONGEST, LONGEST_IN_ALL = 1.0, 12.0
# Most lines of a section.
MOST = 40


class WideProgram:
    """Draws a machine and a program of sections, each from where the one before ended.

    Attributes:
        machine, moves: what was drawn.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self.machine = _machine(rng)
        self.moves: list[Move] = []
        self._here: Array = np.zeros(len(self.machine.axes))
        self._linear = [axis.index for axis in self.machine.axes if axis.type is AxisType.LINEAR]
        self._tolerance = float(rng.choice(TOLERANCES))
        self._timed = bool(rng.random() < 0.4)
        self._asked = 0.0
        kinds = (self._chords, self._walk, self._walk, self._arcs, self._one_axis, self._reversals)
        for _ in range(int(rng.integers(1, 5))):
            if rng.random() < 0.3:
                self._tolerance = float(rng.choice(TOLERANCES))
            if rng.random() < 0.3:
                self._timed = not self._timed
            kinds[int(rng.integers(len(kinds)))]()
        if not self.moves:
            self._chords()

    def _choice(self, values: tuple[float, ...]) -> float:
        return float(self._rng.choice(values))

    def _put(self, curves: list[Curve], share: float | None = None) -> None:
        """Add a line of curves that start together, the first of them at some F or in some T.

        Args:
            share: of the first one's greatest speed that is asked for; None: any F.
        """
        if self._asked > LONGEST_IN_ALL:
            return
        first, machine = curves[0], self.machine
        fastest = min(machine.axes[machine.column_of(axis)].max_velocity for axis in first.axes)
        types = {machine.axes[machine.column_of(axis)].type for axis in first.axes}
        length = max(first.length, 1e-7)
        speed = self._choice(FEEDS) if share is None else share * fastest
        speed = max(speed, length / LONGEST)
        by_path = types == {AxisType.LINEAR} and len(first.axes) <= 3
        by_path = by_path or (types == {AxisType.ROTARY} and len(first.axes) == 1)
        if by_path and not self._timed and first.length > 0.0:
            group = at_speed(speed, *curves)
        else:
            group = in_time(max(length / speed, 1e-3), *curves)
        self._asked += max(group.requested, length / fastest)
        tolerance = self._tolerance if self._rng.random() < 0.95 else self._choice(TOLERANCES)
        self.moves.append(Move(group, bool(self._rng.random() < 0.02), tolerance))
        for curve in curves:
            columns = [machine.column_of(axis) for axis in curve.axes]
            self._here[columns] = curve.position(np.array([1.0]))[0]

    def _line(self, axes: tuple[int, ...], step: Array) -> Curve | None:
        """Return a line from here, rounded as text is; None where it does not travel."""
        digits = int(self._rng.integers(6, 12))
        start = self._here[list(axes)]
        end = np.round(start + step, digits)
        if np.abs(end - start).max() < 1e-9:
            return None
        return line_curve(self.machine, axes, start.tolist(), end.tolist())

    def _axes(self) -> tuple[int, ...]:
        """Some axes, mostly linear ones."""
        if self._rng.random() < 0.7:
            count = int(self._rng.integers(1, len(self._linear) + 1))
            chosen = self._rng.permutation(self._linear)[:count]
        else:
            count = int(self._rng.integers(1, len(self.machine.axes) + 1))
            chosen = self._rng.permutation(len(self.machine.axes))[:count]
        return tuple(int(axis) for axis in chosen)

    def _reachable(self, axes: tuple[int, ...], length: float) -> float:
        """A length that these axes can travel in the time that a line may last."""
        slowest = min(self.machine.axes[self.machine.column_of(axis)].max_velocity for axis in axes)
        return min(length, 0.5 * slowest * LONGEST)

    def _chords(self) -> None:
        """Short lines along a circle, a clothoid, a wave or a figure in any plane, other axes beside."""
        rng = self._rng
        axes = tuple(int(axis) for axis in rng.permutation(self._linear))
        if rng.random() < 0.3 and len(self.machine.axes) > len(axes):
            axes = (*axes, len(self.machine.axes) - 1)
        count = int(rng.integers(4, MOST))
        chord = self._choice((2e-6, 2e-5, 1e-4, 5e-4, 2e-3))
        radius = self._choice((1e-3, 5e-3, 0.05))
        angle = np.arange(count + 1) * chord / radius
        kind = int(rng.integers(4))
        if kind == 0:
            plane = radius * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)
        elif kind == 1:
            heading = angle * np.linspace(-1.0, 1.0, count + 1)
            plane = np.cumsum(chord * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
        elif kind == 2:
            plane = np.stack([radius * angle, 0.2 * radius * np.sin(5.0 * angle)], axis=1)
        else:
            plane = radius * np.stack([np.sin(2.0 * angle), np.sin(3.0 * angle + 0.5)], axis=1)
        points = np.zeros((count + 1, len(axes)))
        points[:, :2] = (plane - plane[0]) @ _rotation(rng.uniform(-3.0, 3.0))
        for column in range(2, len(axes)):
            points[:, column] = self._choice((0.0, 0.1, 2.0)) * radius * angle
        if rng.random() < 0.3:
            points += rng.normal(size=points.shape) * 0.02 * chord
        share, spread = self._choice((0.05, 0.3, 0.9, 3.0)), self._choice((0.0, 0.0, 0.5))
        if rng.random() < 0.2:
            # points that are left out, or stand twice
            keep = rng.integers(0, 3, size=len(points))
            points = np.repeat(points, keep, axis=0) if keep.sum() > 3 else points
        for here, there in itertools.pairwise(points):
            line = self._line(axes, there - here)
            if line is not None:
                self._put([line], share * math.exp(spread * float(rng.normal())))

    def _walk(self) -> None:
        """Lines whose direction turns by little or much, of alike or very different lengths."""
        rng = self._rng
        axes = self._axes()
        heading = rng.normal(size=len(axes))
        heading /= np.linalg.norm(heading)
        mixed = rng.random() < 0.5
        length, turn = self._choice(LENGTHS), self._choice(TURNS)
        share = None if rng.random() < 0.5 else self._choice((0.02, 0.3, 0.9, 2.0))
        for _ in range(int(rng.integers(2, 14))):
            if mixed:
                length, turn = self._choice(LENGTHS), self._choice(TURNS)
            aside = rng.normal(size=len(axes))
            aside -= (aside @ heading) * heading
            if np.linalg.norm(aside) > 1e-6:
                heading = math.cos(turn) * heading + math.sin(turn) * aside / np.linalg.norm(aside)
            line = self._line(axes, self._reachable(axes, length) * heading)
            if line is not None:
                self._put([line, *self._others(line.axes)], share)

    def _others(self, taken: tuple[int, ...]) -> list[Curve]:
        """Now and then further axes that start with a curve and end with it (D-31)."""
        free = [axis.index for axis in self.machine.axes if axis.index not in taken]
        if not free or self._rng.random() < 0.85:
            return []
        axes = (int(self._rng.choice(free)),)
        step = np.array([self._reachable(axes, self._choice(LENGTHS[2:7]))]) * self._rng.choice([-1.0, 1.0])
        line = self._line(axes, step)
        return [] if line is None else [line]

    def _reversals(self) -> None:
        """Lines to and fro, exactly or nearly on each other."""
        rng = self._rng
        axes = self._axes()
        heading = rng.normal(size=len(axes))
        length, beside = self._choice(LENGTHS[2:7]), self._choice((0.0, 1e-7, 1e-4, 0.05))
        share = self._choice((0.1, 0.9, 2.0))
        for index in range(int(rng.integers(2, 8))):
            step = (-1.0) ** index * heading + beside * rng.normal(size=len(axes))
            line = self._line(axes, self._reachable(axes, length) * step / np.linalg.norm(step))
            if line is not None:
                self._put([line], share)

    def _one_axis(self) -> None:
        """Lines of one axis, on and back, short after long."""
        axes = (int(self._rng.integers(len(self.machine.axes))),)
        share = self._choice((0.05, 0.5, 1.5))
        for _ in range(int(self._rng.integers(2, 10))):
            length = self._reachable(axes, self._choice(LENGTHS[1:8]))
            sign = 1.0 if self._rng.random() < 0.8 else -1.0
            line = self._line(axes, np.array([sign * length]))
            if line is not None:
                self._put([line], share if self._rng.random() < 0.7 else None)

    def _arcs(self) -> None:
        """Arcs, helices and spirals in any plane, tangent to what is before them or not."""
        rng = self._rng
        plane = tuple(int(axis) for axis in rng.permutation(self._linear)[:2])
        rising = [axis for axis in self._linear if axis not in plane]
        for _ in range(int(rng.integers(1, 5))):
            radius = self._choice((1e-5, 1e-3, 0.01, 0.1))
            sweep = self._choice((0.02, 0.3, -1.5, 3.14, -6.283185307179586, 15.0))
            angle = float(rng.uniform(-3.1, 3.1))
            if self.moves and rng.random() < 0.6:
                along = tangent(self.machine, self.moves[-1].group, 1.0)[
                    [self.machine.column_of(axis) for axis in plane]
                ]
                if np.linalg.norm(along) > 0.5:
                    angle = math.atan2(along[1], along[0]) + math.copysign(math.pi / 2, sweep)
            start = self._here[[self.machine.column_of(axis) for axis in plane]]
            centre = (
                float(start[0] + radius * math.cos(angle)),
                float(start[1] + radius * math.sin(angle)),
            )
            axes, begin, further = plane, start.tolist(), []
            if rising and rng.random() < 0.4:
                axes = (*plane, rising[0])
                begin.append(float(self._here[self.machine.column_of(rising[0])]))
                further.append(self._choice((1e-4, -2e-3, 0.02)))
            growth = radius * self._choice((0.0, 0.0, 1e-3, -5e-4))
            arc = arc_curve(begin, centre, sweep, axes=axes, further=further, growth=growth)
            self._put([arc, *self._others(axes)], self._choice((0.05, 0.3, 0.9, 2.0)))


def _rotation(angle: float) -> Array:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, sin], [-sin, cos]])


def _machine(rng: np.random.Generator) -> Machine:
    """Two or three linear axes and up to three others, alike or with up to a thousand times between them."""
    kinds = [False] * int(rng.integers(2, 4)) + (rng.random(int(rng.integers(0, 4))) < 0.7).tolist()
    spread = float(rng.choice([1.0, 3.0, 1000.0]))
    limited = float(rng.choice([0.0, 0.7, 1.0, 1.0, 1.0]))
    velocity, acceleration = float(rng.choice([50.0, 300.0])), float(rng.choice([500.0, 5000.0, 20_000.0]))
    rise = float(rng.choice([0.005, 0.02, 0.1]))
    specs = []
    for rotary in kinds:
        low = spread ** float(rng.uniform(-0.5, 0.5))
        jerk = acceleration * low / rise if rng.random() < limited else None
        further = spread ** float(rng.uniform(-0.2, 0.2))
        specs.append(AxisSpec(velocity * low * further, acceleration * low, jerk, rotary=bool(rotary)))
    return machine_of(specs, cycle_hz=float(rng.choice([1000.0, 1000.0, 1000.0, 250.0, 4000.0])))


def wide_program_of(seed: int) -> tuple[Machine, list[Move], list[Commit]]:
    """The machine, the moves and the commits of a seed."""
    rng = np.random.default_rng((seed, 2))
    program = WideProgram(rng)
    count = len(program.moves)
    after = np.sort(rng.integers(1, count + 1, size=int(rng.integers(0, 6)))).tolist()
    ahead = [1.0, 50.0, 200.0, 1000.0, math.inf]
    commits = [Commit(number, float(rng.choice(ahead)), rng.random() < 0.15) for number in after]
    return program.machine, program.moves, commits
