"""Comma lines without a stop: only the group that ends last carries speed to the next line (D-32).

The groups of a line start together and each ends at its own time. The leading group ends last: it is the
line's segment in the lookahead window. The others are its companions, each planned from rest to rest, which
start when the line does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import Bound, PlanningError
from mcserver.motion.canonical import SAME_TIME, FeedGroup, in_one_time
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import NO_TRAVEL, AxisLimits, Segment, anchor, columns_of, segment_of
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.units import MM

# Most that blends at its ends may shorten a line's path, in tolerances.
ROUNDED = 4.0
# Margin for rounding of a line's least time.
LEAST = 0.999


@dataclass(frozen=True)
class Companions:
    """Groups that end before the leading group of their line.

    Attributes:
        runs: their velocity profiles, each from rest to rest. mask: their columns. duration: of the longest,
            those without travel included [s]. set_time: whether they set the line's time, not the leading
            group's own speed or T. bound: limit that stretched the longest of them.
    """

    runs: tuple[PlannedRun, ...]
    mask: int
    duration: float
    set_time: bool = False
    bound: Bound | None = None


@dataclass(frozen=True)
class CommaLine:
    """A comma line that may join its neighbours without a stop.

    Attributes:
        segment: of its leading group. companions: the other groups. end: commanded position of all columns
            at its end, shape (K,).
    """

    segment: Segment
    companions: Companions
    end: Array


@dataclass(frozen=True)
class MachineAxes:
    """Limits of the machine's columns, the columns of axis numbers, which columns are linear, shape (K,), and
    the feed scale that lines are planned at.
    """

    limits: AxisLimits
    slots: dict[int, int]
    linear: NDArray[np.bool_]
    feed_scale: float = 1.0


def comma_line(
    groups: Sequence[FeedGroup],
    line: int,
    tolerance: float,
    position: Array,
    axes: MachineAxes,
) -> CommaLine | None:
    """Choose the leading group of a line of several groups.

    Args:
        tolerance: path tolerance at both ends of the line [m]. position: of all columns at its start,
            shape (K,).

    Returns:
        None where no group is sure to end last.
    """
    if axes.limits.torque is not None:
        # a torque depends on the motion of all groups together, which are planned one by one
        return None
    end = position.copy()
    paths = [_Path.of(group, line, position, end, axes) for group in in_one_time(groups)]
    known = [path for path in paths if path is not None]
    if len(known) < len(paths):
        return None
    lead = max(known, key=lambda path: path.time)
    others = [path for path in known if path is not lead]
    if lead.run is None:
        return None
    last = max(others, key=lambda path: path.time, default=None)
    longest = 0.0 if last is None else last.time
    bound = None if last is None or last.run is None else last.run.bound_by[0]
    segment, set_time = lead.segment, False
    if segment.duration is not None:
        # another group cannot keep T from rest to rest, and ends later
        set_time = longest > segment.duration * (1.0 + SAME_TIME)
    else:
        # if it is passed as fast as its speed allows, another group might end later
        set_time = longest > lead.least_time(tolerance)
    if set_time:
        segment.duration = max(longest, segment.requested)
        segment.requested = segment.duration
    runs = tuple(path.run for path in others if path.run is not None)
    mask = 0
    for run in runs:
        mask |= run.segments[0].mask
    return CommaLine(segment, Companions(runs, mask, longest, set_time, bound), end)


@dataclass(frozen=True)
class _Path:
    """A group planned by itself, from rest to rest.

    Attributes:
        run: its velocity profile; None without travel. time: of the profile [s]. least: lower bound of its
            time with any speed at its ends [s]. in_metres: whether its path speed counts linear columns only.
    """

    group: FeedGroup
    segment: Segment
    run: PlannedRun | None
    time: float
    least: float
    in_metres: bool

    @classmethod
    def of(
        cls,
        group: FeedGroup,
        line: int,
        position: Array,
        end: Array,
        axes: MachineAxes,
    ) -> _Path | None:
        """Plan a group from a ``position`` (K,), and write its columns of ``end`` (K,).

        Returns:
            None where no profile exists.
        """
        segment = segment_of(group, line, axes.slots, axes.linear, axes.feed_scale)
        ahead = position.copy()
        anchor(segment, ahead)
        moved = columns_of(segment.mask)
        end[moved] = ahead[moved]
        segment.active = segment.mask
        if not segment.travels:
            lasting = segment.duration or 0.0
            return cls(group, segment, None, lasting, lasting, False)
        window = Lookahead(axes.limits)
        window.append(msgspec.structs.replace(segment))
        try:
            run = window.plan()
        except PlanningError:
            return None
        least = segment.extent / float(window.table.columns.segment_vmax[0])
        if axes.limits.joint_tolerance is not None and any(c.tool_rates for c in group.curves):
            # a blend within the joint tolerance may cut the tool's path by more than the path tolerance
            least = 0.0
        in_metres = bool(axes.linear[segment.feed_columns].all())
        return cls(group, segment, run, run.phases.duration, least, in_metres)

    def least_time(self, tolerance: float) -> float:
        """Return a lower bound of its time if its ends are rounded within a tolerance [m], in s."""
        curve = self.group.curves[self.group.reference]
        if curve.length <= NO_TRAVEL:
            return 0.0
        # a degree counts as a millimetre
        metres = self.in_metres and curve.tool_rates is None
        rounded = ROUNDED * tolerance * (1.0 if metres else math.radians(1.0) / MM)
        return LEAST * self.least * max(0.0, 1.0 - rounded / curve.length)
