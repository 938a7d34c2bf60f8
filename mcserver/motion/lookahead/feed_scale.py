"""Plan a window again at another feed scale: F times the override, where that is above 100 %."""

from __future__ import annotations

from mcserver.motion.bound import PlanningError
from mcserver.motion.limits.segment_table import SegmentTable
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.planned_run import PlannedRun

# Relative error of a speed by rounding.
SPEED_ROUNDING = 1e-9


def plan_at_feed_scale(window: Lookahead, scale: float) -> PlannedRun | None:
    """Set the feed scale of a window's segments, and plan it.

    A motion under way that is too fast for a lower scale keeps the present one on its first segments, on as
    few as it needs to slow down; the executor plays these more slowly.

    Returns:
        The plan; None, with nothing changed, where all segments have that scale already, or no plan exists.
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
    """Return whether the first segment is the rest of a line with a T.

    At its present speed there may be no profile slow enough for a longer T.
    """
    first = table.segments[0]
    return first.duration is not None and not first.opens


def _may_enter(window: Lookahead) -> bool:
    """Return whether the window's entry speed is within the first segment's speed limit."""
    return window.entry <= float(window.table.columns.segment_vmax[0]) * (1.0 + SPEED_ROUNDING)
