"""Corners of lines with a T of their own (G93), rounded at a steady speed so that each line keeps its T.

Half of a blend belongs to each line (D-33). Both halves are passed at one speed, the lower of the lines' mean
speeds or what the axes allow on the blend, and take from each line's T what that needs. Joints between timed
segments are passed without acceleration, so at a mean speed the rest of the line is not asked for more than
it was; and the shorter the blend, the more of the line is left to get to that speed.
"""

from __future__ import annotations

import math

import msgspec

from mcserver.motion.bound import PlanningError
from mcserver.motion.geometry.blend import Blend, blend, joint_weights
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.lookahead.lookahead import Lookahead

# Shares of the tolerance that are tried for a blend, the longest first.
TOLERANCE_SHARES = (0.85, 0.3, 0.1, 0.03)
# Of the greatest speed on a blend: what is left is for the joints beside it.
TOP_SHARE = 0.98
# A blend that is passed at this share of the lines' mean speed asks for less than the corner did.
STEADY = 0.999
# What is left of a line may be asked for so much more speed before the plan decides.
EVEN = 1.1
# Times that differ by less are one.
ROUNDING = 1e-9


def timed_blend(window: Lookahead, after: Segment, limits: AxisLimits, handle: float) -> Blend | None:
    """Return a blend of the corner after the window's last segment, where one of the two has a T of its own.

    Args:
        after: with the path tolerance. handle: as of `blend`.

    Returns:
        None where the corner is passed as soon as that, or the lines would take longer than with it.
    """
    before = window.table.segments[-1]
    whole = [before, msgspec.structs.replace(after, tolerance=0.0)]
    trial = _chain(limits, whole)
    wanted = STEADY * min(_mean(trial, 0), _mean(trial, 1))
    if window.joint_speed(after) >= wanted:
        return None
    entry = _entry(window, trial)
    best, speed = _shortest(before, after, limits, handle, wanted, None)
    if best is not None and speed >= wanted and entry >= wanted and _even(best, before, after):
        return best
    least = _time(limits, whole, entry)
    if best is not None:
        rounded = _time(limits, _parts(best), entry)
        best, least = (best, rounded) if rounded <= least * (1.0 + ROUNDING) else (None, least)
    at_joints = joint_weights(before, after, limits)
    if at_joints is not None:
        # a T that is kept is kept nearer to the path
        longer, _ = _shortest(before, after, limits, handle, wanted, at_joints)
        if longer is not None and _time(limits, _parts(longer), entry) < least * (1.0 - ROUNDING):
            best = longer
    return best


def _parts(found: Blend) -> list[Segment]:
    return [found.before, found.first, found.second, found.after]


def _shortest(
    before: Segment,
    after: Segment,
    limits: AxisLimits,
    handle: float,
    wanted: float,
    per_joint: Array | None,
) -> tuple[Blend | None, float]:
    """Return the shortest blend that is passed at the speed wanted, or else the longest, and its speed.

    Args:
        per_joint: as of `blend`.
    """
    best: Blend | None = None
    fastest = 0.0
    for share in TOLERANCE_SHARES:
        found = blend(before, after, share * after.tolerance, limits.weights, handle, per_joint)
        speed = 0.0 if found is None else _keep_times(found, before, after, limits)
        if speed < wanted and best is not None:
            break
        if speed > 0.0:
            best, fastest = found, speed
    return best, fastest


def _keep_times(found: Blend, before: Segment, after: Segment, limits: AxisLimits) -> float:
    """Give both halves of a blend their parts of the lines' T; return the speed over it, 0 without one."""
    parts = _parts(found)
    window = _chain(limits, [msgspec.structs.replace(part, duration=None) for part in parts])
    columns = window.table.columns
    ends = window.table.segments
    lengths = [each.extent for each in ends]
    speed = TOP_SHARE * float(columns.axis_vmax[1:3].min())
    for line, inner, outer in ((before, 1, 0), (after, 2, 3)):
        if line.duration is None:
            speed = min(speed, float(columns.segment_vmax[inner]))
        else:
            speed = min(speed, (lengths[inner] + lengths[outer]) / line.duration)
    if not speed > 0.0:
        return 0.0
    for line, inner, outer in ((before, 1, 0), (after, 2, 3)):
        if line.duration is None:
            continue
        spent = lengths[inner] / speed
        if spent >= line.duration:
            return 0.0
        parts[inner].duration = spent
        parts[outer].duration = line.duration - spent
    return speed


def _even(found: Blend, before: Segment, after: Segment) -> bool:
    """Whether what is left of both lines is hardly faster than they were."""
    for line, rest in ((before, found.before), (after, found.after)):
        if line.duration is not None and rest.duration is not None:
            share = (rest.finish - rest.begin) / (line.finish - line.begin)
            if share * line.duration > EVEN * rest.duration:
                return False
    return True


def _chain(limits: AxisLimits, parts: list[Segment]) -> Lookahead:
    window = Lookahead(limits)
    for part in parts:
        window.append(msgspec.structs.replace(part))
    return window


def _mean(window: Lookahead, index: int) -> float:
    """Mean speed that a segment asks for, along σ."""
    segment = window.table.segments[index]
    return segment.feed * segment.scale if segment.duration is None else segment.extent / segment.duration


def _entry(window: Lookahead, trial: Lookahead) -> float:
    """Speed that the last segment of a window may be begun with."""
    count = len(window.table)
    known = float(window.table.columns.junction_vmax[-1]) if count > 1 else window.entry
    return min(known, _mean(trial, 0), float(trial.table.columns.axis_vmax[0]))


def _time(limits: AxisLimits, parts: list[Segment], entry: float) -> float:
    """Time of the parts from a speed to rest [s]."""
    window = _chain(limits, parts)
    window.entry = entry
    try:
        return window.plan().phases.duration
    except PlanningError:
        return math.inf
