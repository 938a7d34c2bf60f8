"""Plan a window again at another feed scale: F times the override, where that is above 100 %."""

from __future__ import annotations

from mcserver.motion.bound import PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.pace import Pace
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.segment_table import SegmentTable

# What rounding may add to a speed.
SPEED_ROUNDING = 1e-9
# Paces that differ by less are the same.
SAME_PACE = 1e-6
# Shares of a change of pace that are tried.
SHARES = (1.0, 0.5)


def plan_at_feed_scale(
    window: Lookahead, scale: float, pace: Pace, latest: Array | None = None, rate: float = 1.0
) -> PlannedRun | None:
    """Let the segments of a window have a feed scale, and plan it.

    The pace of rows goes with it, and with the pace the speed at which the window is entered. Where that does
    not do, the motion under way keeps both; where it is too fast for a lower scale then, it keeps the present
    scale too on its first segments, on as few as it needs to slow down: what is played of them is slowed down
    by the executor.

    Args:
        pace: of the motion under way, or that begins with the window; changed with the scale.
        latest, rate: see `Pace.reachable`.

    Returns:
        The plan; None, and nothing changed, where the segments that may change have that scale already, or no
        plan exists.
    """
    table = window.table
    scales = table.feed_scales
    if len(scales) and not pace.under_way:
        pace.begin(scale)
    if (scales == scale).all():
        return None
    saved = table.save(0)
    table.set_feed_scale(scale)
    found = _plan_at_pace(window, pace, pace.reachable(scale, latest, rate))
    if found is not None:
        return found
    table.put_back(saved)
    kept = 0
    while (scales[kept:] != scale).any():
        table.set_feed_scale(scale, kept)
        if kept or _may_enter(window):
            try:
                found = window.plan()
            except PlanningError:
                pass
            else:
                if not (found.ends_early and _is_under_way(table)):
                    return found
        table.put_back(saved)
        kept = max(1, 2 * kept)
    return None


def _plan_at_pace(window: Lookahead, pace: Pace, wanted: float) -> PlannedRun | None:
    """Plan a window at a pace, or at the nearest that the speed of the motion under way allows; None, and the
    pace as it was, where that is the present one.
    """
    entry, before = window.entry, pace.now
    if entry > 0.0:
        wanted = min(wanted, before * float(window.table.columns.segment_vmax[0]) / entry)
    for share in SHARES:
        now = before + share * (wanted - before)
        if now < 1.0 or abs(now - before) <= SAME_PACE:
            break
        window.entry = entry * (now / before)
        if _may_enter(window):
            try:
                found = window.plan()
            except PlanningError:
                continue
            if found.ends_early:
                continue
            pace.now = now
            return found
    window.entry = entry
    return None


def _is_under_way(table: SegmentTable) -> bool:
    """Return whether the first segment is what is left of a line with a time of its own: at the speed that
    is there it may have no slower profile than for the T that it has.
    """
    first = table.segments[0]
    return first.duration is not None and not first.opens


def _may_enter(window: Lookahead) -> bool:
    """Return whether the first segment may be entered as fast as the window is."""
    return window.entry <= float(window.table.columns.segment_vmax[0]) * (1.0 + SPEED_ROUNDING)
