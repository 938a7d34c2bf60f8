"""Corners of lines with a T of their own (G93), rounded so that each line keeps its T.

Half of a blend belongs to each line (D-33). Both halves are passed at one speed, the lower of the lines' mean
speeds or what the axes allow on the blend, and take from each line's T what that needs. The shorter the
blend, the more of the line is left to get to the speed that the rest of it asks for.
"""

from __future__ import annotations

import math

import msgspec

from mcserver.motion.geometry.blend import Blend, blend
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.lookahead.lookahead import Lookahead

# Shares of the tolerance that are tried for a blend, the longest first.
TOLERANCE_SHARES = (0.85, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
# Of the greatest speed on a blend: what is left is for the joints beside it.
TOP_SHARE = 0.98
# A blend that is passed at this share of the lines' mean speed is passed steadily.
STEADY = 0.999


def as_feed_line(segment: Segment) -> Segment:
    """Return a segment as one of G94 whose F is its mean speed by T; one without T as it is."""
    if segment.duration is None:
        return segment
    feed = (segment.finish - segment.begin) / segment.duration
    of_tool = [feed * curve.length for curve in segment.curves if curve.tool_rates is not None]
    speed = min(of_tool, default=segment.feed_speed)
    return msgspec.structs.replace(segment, duration=None, feed=feed, feed_speed=speed)


def steady_blend(before: Segment, after: Segment, limits: AxisLimits, handle: float) -> Blend | None:
    """Return the shortest blend that is passed at the lower one of the mean speeds; None without one.

    Args:
        before, after: with the path tolerance, and a scale each. handle: as of `blend`.
    """
    best: Blend | None = None
    wanted = STEADY * min(each.feed * each.scale for each in map(as_feed_line, (before, after)))
    low, high = 0, len(TOLERANCE_SHARES)
    while low < high:
        middle = (low + high) // 2 if best is not None else 0
        tolerance = TOLERANCE_SHARES[middle] * after.tolerance
        found = blend(before, after, tolerance, limits.weights, handle)
        if found is not None and keep_times(found, before, after, limits) >= wanted:
            best, low = found, middle + 1
        elif best is None:
            break
        else:
            high = middle
    return best


def keep_times(found: Blend, before: Segment, after: Segment, limits: AxisLimits) -> float:
    """Give both halves of a blend their parts of the lines' T; return the speed over it."""
    parts = (found.before, found.first, found.second, found.after)
    window = Lookahead(limits)
    for part in parts:
        window.append(msgspec.structs.replace(part, duration=None))
    columns = window.table.columns
    lengths = [each.extent for each in window.table.segments]
    halves = ((before, 1, 0), (after, 2, 3))
    speed = TOP_SHARE * float(columns.axis_vmax[1:3].min())
    for line, inner, outer in halves:
        if line.duration is None:
            speed = min(speed, float(columns.segment_vmax[inner]))
        else:
            speed = min(speed, (lengths[inner] + lengths[outer]) / line.duration)
    for line, inner, outer in halves:
        if line.duration is None:
            continue
        spent = lengths[inner] / speed
        if spent >= line.duration:
            # too short a T for either: both are as quick as they can be
            spent = line.duration * lengths[inner] / (lengths[inner] + lengths[outer])
        parts[inner].duration, parts[inner].feed = spent, math.inf
        parts[outer].duration = line.duration - spent
        parts[outer].feed, parts[outer].feed_speed = line.feed, line.feed_speed
        parts[inner].feed_speed = line.feed_speed
    return speed
