"""Segments that flow into each other, as one velocity profile that ends at rest: a planner's window.

Lines that may be chords of a curve wait at its end until it is known what comes behind them; the last corner
is rounded, and the last curve goes on, as more comes. Whatever is changed, a motion under way keeps a stop
that it is sure to reach.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np

from mcserver.motion.bound import PlanningError
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.geometry.segment_rows import SegmentRows
from mcserver.motion.lookahead.blend_choice import best_blend
from mcserver.motion.lookahead.feed_scale import is_under_way
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.smoothing.chord_smoothing import ChordSmoother, Item, OpenCurve, SmoothRun

# What is left to a motion before the part of a curve that may still change: its speed has to follow [s].
ADAPT_S = 0.05


class PlannedWindow:
    """The lookahead window: segments that are not committed yet, and their velocity profile.

    Attributes:
        lookahead: the segments. plan: of all of them; None: some came since the last one.
        reserve: how what is left was planned when it was last committed from: it ends at rest; None: the
            window begins at rest.
    """

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits
        self._smoother = ChordSmoother(limits)
        self.lookahead = Lookahead(limits)
        self.plan: PlannedRun | None = None
        self.reserve: PlannedRun | None = None
        # lines that may be chords of a curve, and what of the curve at the window's end may still change
        self._chords = SegmentList()
        self._open: OpenCurve | None = None

    def __len__(self) -> int:
        """Count the segments, and the lines that wait to come in."""
        return len(self.lookahead.table) + len(self._chords)

    @property
    def moving(self) -> bool:
        """Whether it is entered with a speed."""
        return bool(self.lookahead.table) and self.lookahead.entry > 0.0

    # ------------------------------------------------------------------ what comes in

    def append(self, segment: Segment, *, from_rest: bool = False) -> None:
        """Append a segment that travels, which says how far the corner before it may be rounded.

        Args:
            from_rest: the motion stops before it.
        """
        self.plan = None
        if segment.tolerance > 0.0 and segment.straight:
            self._chords.append(segment)
        else:
            self.take_chords()
            self._append(segment, from_rest=from_rest)

    def append_lines(self, lines: SegmentList, arcs: list[int], *, from_rest: bool, tolerance: float) -> None:
        """Append lines that may be chords, with arcs among them at the places ``arcs``.

        Args:
            from_rest: the motion stops before them. tolerance: how far the corner before them may be
                rounded [m].
        """
        first = lines[0]
        first.tolerance = 0.0 if from_rest else tolerance
        self.append(first, from_rest=from_rest)
        passed = 1
        for arc in arcs:
            if arc >= passed:
                self._chords.extend(lines[passed:arc])
                self.append(lines[arc])
                passed = arc + 1
        self._chords.extend(lines[passed:])

    def append_exact(self, lines: SegmentRows, *, from_rest: bool) -> None:
        """Append a batch of lines and arcs whose corners are not rounded."""
        self.take_chords()
        self.plan = self._open = None
        self.lookahead.append_path(lines, from_rest=from_rest)

    def _append(self, segment: Segment, *, from_rest: bool = False) -> None:
        # what was planned ends before it, and so does a curve
        self.plan = self._open = None
        if segment.tolerance > 0.0 and self.lookahead.table and self._round(segment):
            return
        self.lookahead.append(segment, from_rest=from_rest)

    def _round(self, segment: Segment) -> bool:
        """Round the corner before ``segment``, if that is faster; return False where the corner stays."""
        table = self.lookahead.table
        before = table.segments[-1]
        if not before.closes:
            return False
        found = best_blend(self.lookahead, segment, self._limits)
        if found is None:
            return False
        count, saved = len(table), table.save(len(table) - 1)
        table.replace(-1, found.before)
        for part in (found.first, found.second, found.after):
            part.active = segment.active
            self.lookahead.append(part)
        under_way = self.reserve is not None and count <= self.reserve.window
        # the stop that is held in reserve runs to the untrimmed end: only a plan that is sure to hold may
        # take its place
        if under_way and not self._plan_in_reserve():
            table.put_back(saved)
            return False
        return True

    def _plan_in_reserve(self) -> bool:
        """Plan the window and hold that in reserve for what comes behind; return False, and nothing changed,
        where no plan exists, or a line would end before its T.
        """
        try:
            plan = self.lookahead.plan()
        except PlanningError:
            return False
        if plan.ends_early:
            # the line under way had the rest of its T without this
            return False
        self.plan = self.reserve = plan
        return True

    def take_chords(self) -> None:
        """Let the lines that wait into the window, chords among them as parts of a curve."""
        lines, self._chords = self._chords, SegmentList()
        if not lines:
            return
        table = self.lookahead.table
        curve, self._open = self._open, None
        if curve is not None:
            further = self._smoother.go_on(curve, lines)
            if further is not None and self._put(len(table) - len(curve.chords), None, further):
                return
        last = table.segments[-1] if table else None
        if last is None or not (last.closes and last.straight):
            if not self._put(len(table), None, self._smoother.smooth(lines, rests=False)):
                self._append_each(lines)
            return
        rests = len(table) == 1 and self.lookahead.entry == 0.0 and self.reserve is None
        every = SegmentList([last])
        every.extend(lines)
        first, *items = self._smoother.smooth(every, rests=rests)
        if isinstance(first, SmoothRun):
            done = self._put(len(table) - 1, None, [first, *items])
        else:
            done = self._put(len(table), first, items)
        if not done:
            self._append_each(lines)

    def _append_each(self, lines: SegmentList) -> None:
        for line in lines:
            self._append(line)

    def _put(self, count: int, last: Segment | None, items: list[Item]) -> bool:
        """Put items behind the first ``count`` segments of the window, where nothing else stays.

        Args:
            last: what is left of the last of these segments; None: all of it.

        Returns:
            False, and nothing changed, where the motion under way may not be able to stop on that.
        """
        table = self.lookahead.table
        trimmed = last is not None and last is not table.segments[-1]
        touched = count - 1 if trimmed else count
        saved = table.save(touched)
        reserve = self.reserve
        checked = reserve is not None and touched < reserve.window
        if checked:
            self.reserve = None
        table.truncate(count)
        if last is not None and trimmed:
            table.replace(-1, last)
        for item in items:
            if isinstance(item, Segment):
                self._append(item)
                continue
            self.plan = None
            self.lookahead.append_parts(item.parts, item.samples, joined=item.joined)
        if items and isinstance(items[-1], SmoothRun):
            self._open = items[-1].open
        if not checked:
            return True
        # the stop that is held in reserve runs to the end that was there: only a plan that is sure to hold
        # may take its place
        if not self._plan_in_reserve():
            table.put_back(saved)
            self._open, self.reserve = None, reserve
            return False
        return True

    # ------------------------------------------------------------------ what goes out

    def solved(self) -> PlannedRun:
        """Return the velocity profile of all segments.

        Raises:
            PlanningError: no plan exists, and lines have come since the last one was found.
        """
        if self.plan is None:
            table, reserve = self.lookahead.table, self.reserve
            try:
                plan = self.lookahead.plan()
                if plan.ends_early and is_under_way(table) and reserve is not None and not reserve.ends_early:
                    # the stop in reserve leaves the line under way its T
                    raise PlanningError(table.segments[0].line)
                self.plan = plan
            except PlanningError:
                # the stop in reserve is a velocity profile too, if nothing has come behind it
                if reserve is None or reserve.window < len(table):
                    raise
                self.plan = reserve
        return self.plan

    def end_here(self) -> None:
        """Plan the stop at the end for good: no more lines come that it might be cut for."""
        if not self.lookahead.stop_is_last and self.lookahead.table.bends_at_end:
            self.lookahead.stop_is_last = True
            self.plan = None

    def settled_until(self, plan: PlannedRun) -> float:
        """Return until when nothing of the open curve begins, with time to adapt to what it becomes [s]."""
        if self._open is None:
            return math.inf
        first = len(self.lookahead.table) - len(self._open.chords)
        index = int(np.searchsorted(plan.window_index, first))
        return max(float(plan.times[index]) - ADAPT_S, 0.0)

    def drop_until(self, plan: PlannedRun, moment: float) -> None:
        """Drop what its plan drives up to a moment [s]; what is left goes on at the speed reached there, and
        is driven as it is planned if nothing more comes.
        """
        rest = plan.after(moment)
        table = self.lookahead.table
        table.drop(plan.window_at(moment))
        if self._open is not None:
            # what of the curve is under way stays as it is
            under_way = len(self._open.chords) - len(table) + 1
            self._open = self._open.without(max(under_way, 0))
        first = rest.segments[0]
        if first.begin > table.segments[0].begin:
            # what is left of a segment under way, with what is left of its T
            now = table.segments[0].lasting_less(plan.spent(moment), first.feed_scale)
            table.replace(0, msgspec.structs.replace(now, begin=first.begin, opens=False))
        self.lookahead.entry = max(float(rest.phases.velocity[0]), 0.0)
        self.reserve = self.plan = rest

    def drop_reserve(self) -> PlannedRun:
        """Drop what the stop in reserve drives, and return that; what is left begins at rest.

        Raises:
            PlanningError: the window begins at rest already: its first segment cannot be planned.
        """
        reserve = self.reserve
        if reserve is None:
            raise PlanningError(self.lookahead.table.segments[0].line)
        self.lookahead.table.drop(reserve.window)
        self.lookahead.entry = 0.0
        self._open = self.reserve = self.plan = None
        return reserve

    def clear(self) -> None:
        """Drop all segments: what comes next begins at rest."""
        self.lookahead = Lookahead(self._limits)
        self._open = self.reserve = self.plan = None
