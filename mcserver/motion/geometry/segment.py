"""A segment of the planner: the curves of a feed group, which share one fraction s, in machine columns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import msgspec
import numpy as np
from mckinematics.dynamics import JointDynamics
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.motion.bound import Bound
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.curves import Array, Curve
from mcserver.motion.geometry.torque_limits import TorqueLimits
from mcserver.units import MM, AxisType

_NOWHERE = np.zeros(0)
_NO_COLUMNS = np.zeros(0, np.intp)
# A path whose tangent is shorter than this does not travel [m or rad].
NO_TRAVEL = 1e-10
# T for the rest of a line that has already taken longer than its T [s].
LEAST_T = 1e-6


@dataclass(frozen=True)
class AxisLimits:
    """Limits of the machine's columns in SI, shape (K,) each; infinite where not limited.

    Attributes:
        cycle: [s]. weights: of the columns in the distance from the programmed path: 1 for metres; a degree
            counts as a millimetre.
        torque: limits of the joints' torques; None without any.
        joint_tolerance: largest deviation of each column in a rounded corner of a tool's path [m or rad];
            None: all 0.
    """

    velocity: Array
    acceleration: Array
    jerk: Array
    cycle: float
    weights: Array
    torque: TorqueLimits | None = None
    joint_tolerance: Array | None = None

    @cached_property
    def rows(self) -> Array:
        """Velocity, acceleration and jerk limits, shape (3, K)."""
        return np.array([self.velocity, self.acceleration, self.jerk])

    @cached_property
    def of_samples(self) -> Array:
        """`rows` with a column for each limited torque, shape (3, K + J)."""
        return self.rows if self.torque is None else self.torque.beside(self.rows)

    def bound(self, column: int, kind: str) -> Bound:
        """Return the bound for a column of `of_samples`."""
        width = len(self.velocity)
        if self.torque is None or column < width:
            return Bound(column, kind)
        return Bound(self.torque.column_of(column - width), "torque")

    @classmethod
    def of(cls, machine: Machine, dynamics: JointDynamics | None = None) -> AxisLimits:
        allowed = {
            AxisType.LINEAR: machine.joint_tolerance,
            AxisType.ROTARY: machine.joint_tolerance_angle,
        }
        return cls(
            torque=TorqueLimits.of(machine, dynamics),
            joint_tolerance=(
                np.array([allowed[axis.type] for axis in machine.axes]) if any(allowed.values()) else None
            ),
            velocity=np.array([axis.max_velocity for axis in machine.axes]),
            acceleration=np.array([axis.max_acceleration for axis in machine.axes]),
            jerk=np.array([axis.max_jerk for axis in machine.axes]),
            cycle=machine.cycle_s,
            weights=np.array([MM / axis.type.si_per_unit for axis in machine.axes]),
        )


@dataclass(frozen=True, slots=True)
class KnownBlend:
    """Result of the last search for a time-domain blend at the stop before a segment.

    Attributes:
        blend_time: to either side of the stop, 0 where no blend is worth it [s]. max_blend_time: half of the
            shorter line's time [s]. ramp_time: time of the shorter ramp to or from the stop [s].
    """

    blend_time: float
    max_blend_time: float
    ramp_time: float


class Segment(msgspec.Struct, eq=False, gc=False):
    """A part of the path with its requested time or speed.

    Attributes:
        line: G-code line.
        curves, columns: the curves, and for each the machine's columns of its axes. A straight segment does
            not need them: it may have none.
        mask: bit mask of the columns that it moves.
        duration: T under G93 [s], else None.
        feed: greatest ds/dt under G94 [1/s], infinite under G93: speed / length of the reference curve.
        feed_speed, feed_columns: that speed [m/s or rad/s], and the columns that it counts (D-30). Infinite
            for a straight segment that moves a tool's tip, whose speed is not that of any columns.
        requested: [s].
        feed_scale: feed override above 100 % that the segment is planned for, else 1: ``feed`` and
            ``feed_speed`` are multiplied by it already, ``duration`` and ``requested`` divided [1].
        first, last: dp/ds at s = 0 and 1, shape (K,); zero in columns that do not move.
        d2q_start, d2q_end: d²p/ds² there.
        scale: dσ/ds, with σ the path coordinate; set when the segment is joined to others [m or rad].
        begin, finish: the range of s that is passed: 0 to 1, less after a commit or a rounded corner.
        base: commanded positions of all columns when the segment starts, shape (K,).
        end: end position of a straight segment or an arc, shape (K,).
        active: mask of all columns that the motion has moved up to this segment.
        opens, closes: whether the line's time begins or ends with this segment.
        straight: whether all its curves are lines.
        arc: row of a single arc for `mcserver.motion.kernels.arc_segments`; None: something else.
        carried: tools chosen before it, which determine the payload.
        lever: of a straight segment that moves a tool's tip, `Curve.lever`; else 1.
        tolerance: how far the corner at its start may be rounded [m]. corner: result of the last search for a
            time-domain blend there.
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
    d2q_start: Array
    d2q_end: Array
    scale: float
    begin: float = 0.0
    finish: float = 1.0
    base: Array = msgspec.field(default_factory=lambda: _NOWHERE)
    end: Array = msgspec.field(default_factory=lambda: _NOWHERE)
    active: int = 0
    opens: bool = True
    closes: bool = True
    straight: bool = False
    feed_speed: float = math.inf
    feed_columns: NDArray[np.intp] = msgspec.field(default_factory=lambda: _NO_COLUMNS)
    lever: float = 1.0
    tolerance: float = 0.0
    corner: KnownBlend | None = None
    carried: tuple[int, ...] = ()
    feed_scale: float = 1.0
    arc: Array | None = None

    @property
    def only_feed_columns(self) -> bool:
        """Whether it moves exactly the columns that the path speed counts."""
        counted: int = sum(1 << column for column in self.feed_columns.tolist())
        return self.mask == counted

    @property
    def is_plain_line(self) -> bool:
        """Whether it is a straight line of just the columns that the path speed counts, and leads no tip."""
        return self.straight and self.only_feed_columns and not self.leads_tip

    @property
    def leads_tip(self) -> bool:
        """Whether it moves a tool's tip whose corners may be rounded."""
        return any(curve.tool_rates is not None for curve in self.curves)

    @property
    def may_be_split(self) -> bool:
        """Whether it is planned in zones if it is long: a straight segment without a T."""
        return self.straight and self.duration is None

    @property
    def extent(self) -> float:
        """Length of its remaining part along σ."""
        return self.scale * (self.finish - self.begin)

    @property
    def travels(self) -> bool:
        return self.scale > NO_TRAVEL

    def between(self, begin: float, finish: float) -> Segment:
        """Return the part between two fractions, with its share of T."""
        duration = self.duration
        if duration is not None:
            duration *= (finish - begin) / (self.finish - self.begin)
        return msgspec.structs.replace(self, begin=begin, finish=finish, duration=duration)

    def at_feed_scale(self, scale: float) -> Segment:
        """Return the segment with another feed scale."""
        share = scale / self.feed_scale
        # a blend that was found is tried again first; where none was found, the new F may allow one
        corner = self.corner if self.corner is not None and self.corner.blend_time > 0.0 else None
        return msgspec.structs.replace(
            self,
            duration=None if self.duration is None else self.duration / share,
            feed=self.feed * share,
            feed_speed=self.feed_speed * share,
            requested=self.requested / share,
            feed_scale=scale,
            corner=corner,
        )

    def lasting_less(self, spent: float, feed_scale: float) -> Segment:
        """Return the segment with the rest of its T, if it has one.

        Args:
            spent: time taken from T [s]; negative adds. feed_scale: at which ``spent`` was measured.
        """
        if self.duration is None or spent == 0.0:
            return self
        left = max(self.duration - spent * feed_scale / self.feed_scale, LEAST_T)
        return msgspec.structs.replace(self, duration=left)

    def sample(self, s: Array) -> tuple[Array, Array]:
        """Return the position and dp/ds in all columns, shape (len(s), K); other columns rest at ``base``."""
        if self.straight:
            return self._sample_line(s)
        position = np.tile(self.base, (len(s), 1))
        slope = np.zeros_like(position)
        for curve, columns in zip(self.curves, self.columns, strict=True):
            position[:, columns] = curve.position(s)
            slope[:, columns] = curve.derivatives(s)[0]
        return position, slope

    def _sample_line(self, s: Array) -> tuple[Array, Array]:
        slope = np.tile(self.first, (len(s), 1))
        position = self.base + s[:, None] * slope
        # start + (end - start) need not be end in floating point; the target is exact
        position[s >= 1.0] = self.end
        return position, slope

    def derivatives(self, s: Array, width: int) -> tuple[Array, Array, Array]:
        """dp/ds, d²p/ds², d³p/ds³ in all columns, shape (len(s), width)."""
        result = (np.zeros((len(s), width)), np.zeros((len(s), width)), np.zeros((len(s), width)))
        if self.straight:
            result[0][:] = self.first
            return result
        for curve, columns in zip(self.curves, self.columns, strict=True):
            for whole, part in zip(result, curve.derivatives(s), strict=True):
                whole[:, columns] = part
        return result


_ENDS = np.array([0.0, 1.0])


def segment_of(
    group: FeedGroup,
    line: int,
    slots: dict[int, int],
    linear: NDArray[np.bool_],
    feed_scale: float = 1.0,
) -> Segment:
    """Return the segment of a feed group at a feed scale.

    Args:
        slots: columns by axis number. linear: whether each of the machine's columns is linear, shape (K,).
    """
    width = len(linear)
    columns = tuple(np.array([slots[axis] for axis in curve.axes], dtype=np.intp) for curve in group.curves)
    first, last, d2q_start, d2q_end = np.zeros((4, width))
    mask = 0
    straight = True
    for curve, where in zip(group.curves, columns, strict=True):
        for axis in curve.axes:
            mask |= 1 << slots[axis]
        if curve.straight:
            start, end = curve.ends()
            first[where] = last[where] = end - start
            continue
        straight = False
        slope, bend, _ = curve.derivatives(_ENDS)
        first[where], last[where] = slope
        d2q_start[where], d2q_end[where] = bend
    scale = math.sqrt(float(first @ first))
    feed = feed_speed = math.inf
    feed_columns = columns[group.reference]
    if linear[feed_columns].any():
        feed_columns = feed_columns[linear[feed_columns]]
    if group.speed is not None:
        feed_speed = group.speed
        length = group.curves[group.reference].max_path_rate
        feed = (
            group.speed / length
            if length > NO_TRAVEL
            else (1.0 / group.requested if group.requested > 0.0 else math.inf)
        )
        if straight and group.curves[group.reference].tool_rates is not None:
            feed_speed = math.inf
    arc = group.curves[0].arc
    segment = Segment(
        line=line,
        curves=group.curves,
        columns=columns,
        mask=mask,
        duration=group.duration,
        feed=feed,
        requested=group.requested,
        first=first,
        last=last,
        d2q_start=d2q_start,
        d2q_end=d2q_end,
        scale=scale,
        straight=straight,
        feed_speed=feed_speed,
        feed_columns=feed_columns,
        carried=group.carried,
        lever=max(curve.lever for curve in group.curves),
        arc=None if arc is None or len(columns) > 1 else np.concatenate((columns[0][:2], arc)),
    )
    return segment if feed_scale == 1.0 else segment.at_feed_scale(feed_scale)


def anchor(segment: Segment, position: Array) -> None:
    """Anchor a segment at the commanded position, and advance ``position`` (K,) to its end."""
    segment.base = position.copy()
    for curve, columns in zip(segment.curves, segment.columns, strict=True):
        start, position[columns] = curve.ends()
        if curve.straight or segment.arc is not None:
            segment.base[columns] = start
    if segment.straight or segment.arc is not None:
        segment.end = position.copy()


def columns_of(mask: int) -> NDArray[np.intp]:
    """Return the columns whose bit is set."""
    return np.array([bit for bit in range(mask.bit_length()) if mask >> bit & 1], dtype=np.intp)
