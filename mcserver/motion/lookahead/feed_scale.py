"""Plan a window again at another feed scale: F times the override, where that is above 100 %."""

from __future__ import annotations

from mcserver.motion.bound import PlanningError
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.planned_run import PlannedRun

# What rounding may add to a speed.
SPEED_ROUNDING = 1e-9


def plan_at_feed_scale(window: Lookahead, scale: float) -> PlannedRun | None:
    """Let the segments of a window have a feed scale, and plan it.

    A motion under way that is too fast for a lower scale keeps the present one on its first segments, on as
    few as it needs to slow down: what is played of them is slowed down by the executor.

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
        if kept or window.entry <= float(table.columns.segment_vmax[0]) * (1.0 + SPEED_ROUNDING):
            try:
                return window.plan()
            except PlanningError:
                pass
        table.put_back(saved)
        kept = max(1, 2 * kept)
    return None
