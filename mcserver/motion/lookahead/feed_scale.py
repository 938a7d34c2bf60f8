"""Plan a window again at another feed scale: F times the override, where that is above 100 %."""

from __future__ import annotations

from mcserver.motion.bound import PlanningError
from mcserver.motion.limits.segment_table import SegmentTable
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.planned_run import PlannedRun

# What rounding may add to a speed.
SPEED_ROUNDING = 1e-9


def plan_at_feed_scale(window: Lookahead, scale: float) -> PlannedRun | None:
    """Let the segments of a window have a feed scale, and plan it.

    A motion under way that is too fast for a lower one keeps the present scale on its first segments, on as
    few as it needs to slow down: these are played more slowly by the executor.

    Returns:
        The plan; None, and nothing changed, where the segments that may change have that scale already, or no
        plan exists.
    """
    table = window.table
    scales = table.feed_scales
    if (scales == scale).all():
        return None
    saved = table.save(0)
    kept = 0
    while (scales[kept:] != scale).any():
        table.set_feed_scale(scale, kept)
        if kept or _may_enter(window):
            try:
                found = window.plan()
            except PlanningError:
                pass
            else:
                if not (found.ends_early and is_under_way(table)):
                    return found
        table.put_back(saved)
        kept = max(1, 2 * kept)
    return None


def is_under_way(table: SegmentTable) -> bool:
    """Return whether the first segment is what is left of a line with a T of its own: at the speed that
    is there it may have no slower profile than for the T that it has.
    """
    first = table.segments[0]
    return first.duration is not None and not first.opens


def _may_enter(window: Lookahead) -> bool:
    """Return whether the first segment may be entered as fast as the window is."""
    return window.entry <= float(window.table.columns.segment_vmax[0]) * (1.0 + SPEED_ROUNDING)
