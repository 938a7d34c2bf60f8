"""One piece of path for the planner: the curves of a group that share one fraction s, in machine columns."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mcserver.config import Machine
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.path import Array, Curve, LineCurve

_NOWHERE = np.zeros(0)
# A path whose tangent is shorter than this does not travel [m or rad].
NO_TRAVEL = 1e-10


@dataclass(frozen=True)
class AxisLimits:
    """Limits of the machine's columns in SI, shape (K,) each; infinite where not limited."""

    velocity: Array
    acceleration: Array
    jerk: Array
    cycle: float

    @cached_property
    def rows(self) -> Array:
        """The three of them, shape (3, K)."""
        return np.array([self.velocity, self.acceleration, self.jerk])

    @classmethod
    def of(cls, machine: Machine) -> AxisLimits:
        return cls(
            velocity=np.array([axis.max_velocity for axis in machine.axes]),
            acceleration=np.array([axis.max_acceleration for axis in machine.axes]),
            jerk=np.array([axis.max_jerk for axis in machine.axes]),
            cycle=machine.cycle_s,
        )


@dataclass
class Segment:
    """A piece of path with a request of time.

    Attributes:
        line: G-code line.
        curves, columns: the curves, and for each the machine's columns of its axes.
        mask: bit mask over all columns.
        duration: T under G93 [s], else None.
        feed: greatest ds/dt under G94 [1/s], infinite under G93: speed / length of the reference curve.
        requested: [s].
        first, last: dp/ds at s = 0 and 1, shape (K,); zero where an axis has no part.
        bend_first, bend_last: d²p/ds² there.
        scale: length of the tangent that the coordinate σ is measured in; set along a run [m or rad].
        begin, finish: fractions between which the segment is passed: 0 and 1 but for one that is under way or
            has a rounded corner.
        base: commanded positions of all columns when the segment starts, shape (K,).
        end: where a straight one ends, shape (K,).
        active: mask of all columns that the run has moved up to this segment.
        opens, closes: whether the line's time begins or ends with this segment.
        straight: whether all its curves are lines.
    """

    line: int
    curves: tuple[Curve, ...]
    columns: tuple[NDArray[np.intp], ...]
    mask: int
    duration: float | None
    feed: float
    requested: float
    first: Array
    last: Array
    bend_first: Array
    bend_last: Array
    scale: float
    begin: float = 0.0
    finish: float = 1.0
    base: Array = field(default_factory=lambda: _NOWHERE)
    end: Array = field(default_factory=lambda: _NOWHERE)
    active: int = 0
    opens: bool = True
    closes: bool = True
    straight: bool = False

    @property
    def extent(self) -> float:
        """Length of what is left of it along σ."""
        return self.scale * (self.finish - self.begin)

    @property
    def travels(self) -> bool:
        return self.scale > NO_TRAVEL

    def sample(self, s: Array) -> tuple[Array, Array]:
        """Position and dp/ds in all columns, shape (len(s), K); other columns rest at ``base``."""
        position = np.tile(self.base, (len(s), 1))
        slope = np.zeros_like(position)
        for curve, columns in zip(self.curves, self.columns, strict=True):
            position[:, columns] = curve.position(s)
            slope[:, columns] = curve.derivatives(s)[0]
        return position, slope

    def derivatives(self, s: Array, width: int) -> tuple[Array, Array, Array]:
        """dp/ds, d²p/ds², d³p/ds³ in all columns, shape (len(s), width)."""
        result = (np.zeros((len(s), width)), np.zeros((len(s), width)), np.zeros((len(s), width)))
        for curve, columns in zip(self.curves, self.columns, strict=True):
            for whole, part in zip(result, curve.derivatives(s), strict=True):
                whole[:, columns] = part
        return result


_ENDS = np.array([0.0, 1.0])
_END = _ENDS[1:]


def segment_of(group: FeedGroup, line: int, slots: dict[int, int], width: int) -> Segment:
    """The segment of a feed group; ``slots`` maps axis numbers to columns."""
    columns = tuple(np.array([slots[axis] for axis in curve.axes], dtype=np.intp) for curve in group.curves)
    first, last, bend_first, bend_last = np.zeros((4, width))
    mask = 0
    straight = True
    for curve, where in zip(group.curves, columns, strict=True):
        for axis in curve.axes:
            mask |= 1 << slots[axis]
        if isinstance(curve, LineCurve):
            travel = np.subtract(curve.end, curve.start)
            first[where] = travel
            last[where] = travel
        else:
            straight = False
            slope, bend, _ = curve.derivatives(_ENDS)
            first[where], last[where] = slope
            bend_first[where], bend_last[where] = bend
    scale = math.sqrt(float(first @ first))
    feed = math.inf
    if group.speed is not None:
        length = group.curves[group.reference].length
        feed = (
            group.speed / length
            if length > NO_TRAVEL
            else (1.0 / group.requested if group.requested > 0.0 else math.inf)
        )
    return Segment(
        line=line,
        curves=group.curves,
        columns=columns,
        mask=mask,
        duration=group.duration,
        feed=feed,
        requested=group.requested,
        first=first,
        last=last,
        bend_first=bend_first,
        bend_last=bend_last,
        scale=scale,
        straight=straight,
    )


def place(segment: Segment, position: Array) -> None:
    """Puts a segment where the machine stands, and moves ``position`` (K,) on to its end."""
    segment.base = position.copy()
    for curve, columns in zip(segment.curves, segment.columns, strict=True):
        if isinstance(curve, LineCurve):
            segment.base[columns] = curve.start
            position[columns] = curve.end
        else:
            position[columns] = curve.position(_END)[0]
    if segment.straight:
        segment.end = position.copy()


def columns_of(mask: int) -> NDArray[np.intp]:
    """Columns whose bit is set."""
    return np.array([bit for bit in range(mask.bit_length()) if mask >> bit & 1], dtype=np.intp)
