"""Round corners of lines with a T (G93) so that each line keeps its T.

Half of a blend belongs to each line (D-33). Both halves are passed at one speed, the lowest of the lines'
mean speeds and what the axes allow on the blend, and their time is taken from each line's T. The shorter the
blend, the more of the line is left to reach the speed that the rest of T requires.
"""

from __future__ import annotations

import math

import msgspec

from mcserver.motion.geometry.blend import Blend, blend
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.lookahead.lookahead import Lookahead

# Shares of the tolerance that are tried for a blend.
TOLERANCE_SHARES = (0.85, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
# Share of the axes' speed limit on a blend; the rest is for the junctions beside it.
TOP_SHARE = 0.98
# A blend is steady if it is passed at this share of the lower mean speed.
STEADY = 0.999


def as_feed_line(segment: Segment) -> Segment:
    """Return a segment with a T as a G94 segment whose F is its mean speed; another unchanged."""
    if segment.duration is None:
        return segment
    feed = (segment.finish - segment.begin) / segment.duration
    of_tool = [feed * curve.length for curve in segment.curves if curve.tool_rates is not None]
    speed = min(of_tool, default=segment.feed_speed)
    return msgspec.structs.replace(segment, duration=None, feed=feed, feed_speed=speed)


def steady_blend(before: Segment, after: Segment, limits: AxisLimits) -> Blend | None:
    """Return the shortest blend that can be passed at the lower of the mean speeds; None without one.

    Args:
        before, after: scaled, with the path tolerance in ``after``.
    """
    best: Blend | None = None
    wanted = STEADY * min(each.feed * each.scale for each in map(as_feed_line, (before, after)))
    low, high = 0, len(TOLERANCE_SHARES)
    while low < high:
        middle = (low + high) // 2 if best is not None else 0
        tolerance = TOLERANCE_SHARES[middle] * after.tolerance
        found = blend(before, after, tolerance, limits.weights)
        if found is not None and keep_times(found, before, after, limits) >= wanted:
            best, low = found, middle + 1
        elif best is None:
            break
        else:
            high = middle
    return best


def keep_times(found: Blend, before: Segment, after: Segment, limits: AxisLimits) -> float:
    """Divide the T of each line between its half of a blend and its rest; return the speed on the blend."""
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
            # T is too short: half and rest are both passed as fast as they can be
            spent = line.duration * lengths[inner] / (lengths[inner] + lengths[outer])
        parts[inner].duration, parts[inner].feed = spent, math.inf
        parts[outer].duration = line.duration - spent
        parts[outer].feed, parts[outer].feed_speed = line.feed, line.feed_speed
        parts[inner].feed_speed = line.feed_speed
    return speed
