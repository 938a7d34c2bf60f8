"""Which rounding of a corner is quickest, judged by the same time laws that will drive it."""

from __future__ import annotations

import dataclasses
import math

from mcserver.motion.blend import Blend, blend, straight_blend
from mcserver.motion.bound import PlanningError
from mcserver.motion.kernels.corners import BETTER, FASTER, may_win
from mcserver.motion.kernels.groups import TOP
from mcserver.motion.lookahead import Lookahead
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
    before = window.nodes.segments[-1]
    speed = window.joint_speed(after)
    if speed >= min(float(window.nodes.numbers[-1, TOP]), after.feed * after.scale):
        return None
    if before.straight and after.straight:
        return straight_blend(before, after, tolerance, weights, HANDLE, TOLERANCE_SHARES, limits)
    best: Blend | None = None
    from_rest, _ = _time(limits, [before, after], fast=False)
    least = math.inf
    if speed <= 0.0:
        least, _ = _time(limits, [before, after], fast=True)
    fastest = FASTER * speed
    for share in TOLERANCE_SHARES:
        found = blend(before, after, share * tolerance, weights, HANDLE)
        if found is None:
            continue
        parts = [found.before, found.first, found.second, found.after]
        slow, top = _time(limits, parts, fast=False)
        if not may_win(speed, from_rest, slow, top, fastest):
            continue
        if speed > 0.0:
            best, fastest = found, top
            continue
        time, _ = _time(limits, parts, fast=True)
        if time < least * BETTER:
            best, least = found, time
    return best


def _time(limits: AxisLimits, parts: list[Segment], *, fast: bool) -> tuple[float, float]:
    """How long the parts take to rest, and the greatest speed on those in the middle.

    Args:
        fast: from the speed that the first one could have, not from rest.
    """
    window = Lookahead(limits)
    for part in parts:
        window.append(dataclasses.replace(part))
    top = float(window.nodes.numbers[1:-1, TOP].min(initial=math.inf))
    if fast:
        window.enter_fast()
    try:
        return window.plan().phases.duration, top
    except PlanningError:
        return math.inf, top
