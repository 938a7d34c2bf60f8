"""Which rounding of a corner is quickest, judged by the same time laws that will drive it."""

from __future__ import annotations

import dataclasses
import math

from mcserver.motion.blend import Blend, blend, straight_blend
from mcserver.motion.lookahead import Lookahead
from mcserver.motion.node import PlanningError
from mcserver.motion.path import Array
from mcserver.motion.segment import AxisLimits, Segment

# Shape, and shares of the tolerance that are tried for a rounded corner: what is left of it is for rows that
# fall beside the nearest place.
HANDLE = 0.4
TOLERANCE_SHARES = (0.85, 0.3)


def best_blend(
    window: Lookahead, after: Segment, tolerance: float, weights: Array, limits: AxisLimits
) -> Blend | None:
    """The blend that passes the corner after the window's last segment soonest, if any beats the
    corner itself.

    Args:
        tolerance: largest distance from the programmed path [m].
        weights: of each column in that distance, shape (K,).
    """
    before = window.nodes[-1].segment
    if window.joint_speed(after) >= min(window.nodes[-1].top, after.feed * after.scale):
        return None
    if before.straight and after.straight:
        return straight_blend(before, after, tolerance, weights, HANDLE, TOLERANCE_SHARES, limits)
    best: Blend | None = None
    least = _time(limits, [before, after])
    for share in TOLERANCE_SHARES:
        found = blend(before, after, share * tolerance, weights, HANDLE)
        if found is not None:
            time = _time(limits, [found.before, found.first, found.second, found.after])
            if time < least * (1.0 - 1e-6):
                best, least = found, time
    return best


def _time(limits: AxisLimits, parts: list[Segment]) -> float:
    """How long the parts take from the speed that the first one could have to rest [s]."""
    window = Lookahead(limits)
    for part in parts:
        window.append(dataclasses.replace(part))
    window.enter_fast()
    try:
        return window.plan().phases.duration
    except PlanningError:
        return math.inf
