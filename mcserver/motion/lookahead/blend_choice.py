"""Choose the corner blend that takes least time, by planning velocity profiles over the candidates."""

from __future__ import annotations

import math

import msgspec

from mcserver.motion.bound import PlanningError
from mcserver.motion.geometry.blend import TOLERANCE_SHARES, Blend, blend, joint_weights, straight_blend
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.kernels.straight_corner import BETTER, FASTER, is_worthwhile
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.timed_blend import as_feed_line, keep_times, steady_blend

# Shares of a joint tolerance that are tried: all of it may be far more than saves time.
JOINT_SHARES = (0.98, 0.4, 0.15, 0.05)
# Two lines' mean speeds are alike if the lower is at least this share of the other.
ALIKE = 0.5
# Relative difference below which two times count as equal.
ROUNDING = 1e-9


def best_blend(window: Lookahead, after: Segment, limits: AxisLimits) -> Blend | None:
    """Return the fastest blend of the corner between the window's last segment and ``after``.

    ``after.tolerance`` is the path tolerance.

    Returns:
        None where no blend is faster than the corner itself.
    """
    before, speed = window.table.segments[-1], window.joint_speed(after)
    lines = as_feed_line(before), as_feed_line(after)
    top = min(float(window.table.columns.segment_vmax[-1]), *(line.feed * line.scale for line in lines))
    if speed >= top:
        return None
    if before.duration is None and after.duration is None:
        return _quickest(before, after, limits, speed, overlaps=True)
    found = steady_blend(before, after, limits)
    if found is None:
        found = _quickest_timed(before, after, limits, speed)
    slower, faster = sorted(line.feed * line.scale for line in lines)
    if found is None or slower >= ALIKE * faster:
        return found
    # half of the blend belongs to the slower line: the faster one may lose more time by it than by a stop
    whole = [before, msgspec.structs.replace(after, tolerance=0.0)]
    least, _ = _time(limits, whole, fast=True, stops=True)
    time, _ = _time(limits, _parts(found), fast=True)
    return found if time <= least else None


def _quickest_timed(before: Segment, after: Segment, limits: AxisLimits, speed: float) -> Blend | None:
    """Return the fastest blend of a corner where a line has a T; None where a stop is as fast.

    Tries the path tolerance alone, and joined by the joint tolerance if there is one.
    """
    least = math.inf
    best: Blend | None = None
    lines = as_feed_line(before), as_feed_line(after)
    kinds = (False, True) if joint_weights(before, after, limits) is not None else (False,)
    for at_joints in kinds:
        found = _quickest(*lines, limits, speed, overlaps=False, at_joints=at_joints)
        parts = [before, msgspec.structs.replace(after, tolerance=0.0)]
        if found is not None:
            keep_times(found, before, after, limits)
            parts = _parts(found)
        if len(kinds) == 1:
            return found
        time, _ = _time(limits, parts, fast=True, stops=found is None and speed <= 0.0)
        if time < least * (1.0 - ROUNDING):
            best, least = found, time
    return best


def _parts(found: Blend) -> list[Segment]:
    return [found.before, found.first, found.second, found.after]


def _quickest(
    before: Segment,
    after: Segment,
    limits: AxisLimits,
    speed: float,
    *,
    overlaps: bool,
    at_joints: bool = True,
) -> Blend | None:
    """Return the fastest blend of the corner between two feed lines; None as in `best_blend`.

    Args:
        speed: over the corner itself. overlaps: whether a time-domain blend may replace a stop there.
        at_joints: whether the joint tolerance may be used too.
    """
    if before.is_plain_line and after.is_plain_line:
        found = straight_blend(before, after, limits)
        if found is not None and speed <= 0.0 and overlaps:
            gain = _gain_in_time(limits, before, after)
            if gain > 0.0:
                found = straight_blend(before, after, limits, gain)
        return found
    best: Blend | None = None
    whole = [before, msgspec.structs.replace(after, tolerance=0.0)]
    from_rest, _ = _time(limits, whole, fast=False, stops=speed <= 0.0)
    least = math.inf
    if speed <= 0.0:
        least, _ = _time(limits, [before, after] if overlaps else whole, fast=True, stops=not overlaps)
    fastest = FASTER * speed
    weights = joint_weights(before, after, limits) if at_joints else None
    shares: list[tuple[Array | None, float]] = [(None, share) for share in TOLERANCE_SHARES]
    if weights is not None:
        shares += [(weights, share) for share in JOINT_SHARES]
    for per_joint, share in shares:
        found = blend(before, after, share * after.tolerance, limits.weights, per_joint)
        if found is None:
            continue
        parts = _parts(found)
        slow, top = _time(limits, parts, fast=False)
        if not is_worthwhile(speed, from_rest, slow, top, fastest):
            continue
        if speed > 0.0:
            best, fastest = found, top
            continue
        time, _ = _time(limits, parts, fast=True)
        if time < least * BETTER:
            best, least = found, time
    return best


def _gain_in_time(limits: AxisLimits, before: Segment, after: Segment) -> float:
    """Return the time that a time-domain blend saves at the stop between two segments [s].

    Both are planned from rest to rest.
    """
    window = Lookahead(limits)
    window.append(msgspec.structs.replace(before))
    behind = msgspec.structs.replace(after)
    window.append(behind)
    try:
        run = window.plan()
    except PlanningError:
        return 0.0
    corner = run.phases.rows[run.timed, 0]
    return 2.0 * behind.corner.blend_time - float(corner[0]) if len(corner) and behind.corner else 0.0


def _time(
    limits: AxisLimits, parts: list[Segment], *, fast: bool, stops: bool = False
) -> tuple[float, float]:
    """Return the time of segments from entry to rest [s], and the lowest speed limit of the middle ones.

    Args:
        fast: enter at the speed that the first one could have reached, not from rest. stops: at every
            junction.
    """
    window = Lookahead(limits)
    for part in parts:
        window.append(msgspec.structs.replace(part), from_rest=stops)
    top = float(window.table.columns.segment_vmax[1:-1].min(initial=math.inf))
    if fast:
        window.enter_fast()
    try:
        return window.plan().phases.duration, top
    except PlanningError:
        return math.inf, top
