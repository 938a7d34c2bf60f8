"""The lookahead window: segments planned as one velocity profile that ends at rest.

Lines that may be chords of a curve wait at the window's end until the lines after them are known. Appending
may still round the last corner and extend the last curve. Whatever is changed, a motion under way keeps a
plan that stops it on its path.
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
from mcserver.motion.smoothing.neighbours import Neighbours

# Committed motion keeps this distance in time from the part of a curve that may still change, so that its
# speed can adapt to the change [s].
ADAPT_S = 0.05


class PlannedWindow:
    """The lookahead window: segments that are not committed yet, and their velocity profile.

    Attributes:
        lookahead: the segments. plan: of all of them; None: segments have come since the last plan.
        reserve: the part of the last committed plan that has not been handed over, down to its stop; None:
            the window begins at rest.
    """

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits
        self._smoother = ChordSmoother(limits)
        self.lookahead = Lookahead(limits)
        self.plan: PlannedRun | None = None
        self.reserve: PlannedRun | None = None
        # lines that may be chords of a curve, and the part of the last curve that may still change
        self._chords = SegmentList()
        self._open: OpenCurve | None = None

    def __len__(self) -> int:
        """Count the segments, and the chords that wait to be appended."""
        return len(self.lookahead.table) + len(self._chords)

    @property
    def moving(self) -> bool:
        """Whether it is entered with a speed."""
        return bool(self.lookahead.table) and self.lookahead.entry > 0.0

    # ------------------------------------------------------------------ what comes in

    def append(self, segment: Segment, *, from_rest: bool = False) -> None:
        """Append a segment that travels; its tolerance says how far the corner before it may be rounded.

        Args:
            from_rest: the motion stops before it.
        """
        self.plan = None
        if segment.tolerance > 0.0 and segment.straight:
            self._chords.append(segment)
        else:
            self.take_chords(None if from_rest or segment.tolerance == 0.0 else segment)
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
        # plan and curve end before this segment
        self.plan = self._open = None
        if segment.tolerance > 0.0 and self.lookahead.table and self._round(segment):
            return
        self.lookahead.append(segment, from_rest=from_rest)

    def _round(self, segment: Segment) -> bool:
        """Append ``segment`` behind a rounded corner, if that is faster; return False if nothing was done."""
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
        # the reserve stops at the untrimmed end, which is gone: round only if a new plan replaces it
        if under_way and not self._plan_in_reserve():
            table.put_back(saved)
            return False
        return True

    def _plan_in_reserve(self) -> bool:
        """Plan the window and make that the reserve.

        Returns:
            False, with nothing changed, where no plan exists or a line would end before its T.
        """
        try:
            plan = self.lookahead.plan()
        except PlanningError:
            return False
        if plan.ends_early:
            # without this change the line under way keeps its T
            return False
        self.plan = self.reserve = plan
        return True

    def take_chords(self, into: Segment | None = None) -> None:
        """Append the lines that wait, smoothing chords of a curve among them.

        Args:
            into: as of `Neighbours`.
        """
        lines, self._chords = self._chords, SegmentList()
        if not lines and (into is None or self._open is None):
            return
        table = self.lookahead.table
        curve, self._open = self._open, None
        if curve is not None:
            further = self._smoother.go_on(curve, lines, into)
            if further is not None and self._put(len(table) - len(curve.chords), None, further):
                return
        if not lines:
            return
        last = table.segments[-1] if table else None
        if last is None or not (last.closes and last.straight):
            flows = last is not None and last.closes and lines[0].tolerance > 0.0
            beside = Neighbours(last if flows else None, into)
            if not self._put(len(table), None, self._smoother.smooth(lines, rests=False, beside=beside)):
                self._append_each(lines)
            return
        rests = len(table) == 1 and self.lookahead.entry == 0.0 and self.reserve is None
        every = SegmentList([last])
        every.extend(lines)
        first, *items = self._smoother.smooth(every, rests=rests, beside=Neighbours(into=into))
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
        """Replace all but the first ``count`` segments of the window by items.

        Args:
            last: the last of these segments, trimmed; None: whole.

        Returns:
            False, with nothing changed, where the motion under way may not be able to stop on the new path.
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
        # the reserve stops at the former end, which is gone: change it only if a new plan replaces it
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
                    # the reserve keeps the T of the line under way
                    raise PlanningError(table.segments[0].line)
                self.plan = plan
            except PlanningError:
                # the reserve plans the whole window if no segment has come since
                if reserve is None or reserve.window < len(table):
                    raise
                self.plan = reserve
        return self.plan

    def end_here(self) -> None:
        """Make the stop at the window's end final: no more lines come."""
        if not self.lookahead.stop_is_last and self.lookahead.table.bends_at_end:
            self.lookahead.stop_is_last = True
            self.plan = None

    def settled_until(self, plan: PlannedRun) -> float:
        """Return the time until which a plan may be committed without touching the open curve [s].

        Leaves `ADAPT_S` before the curve begins; infinite without an open curve.
        """
        if self._open is None:
            return math.inf
        first = len(self.lookahead.table) - len(self._open.chords)
        index = int(np.searchsorted(plan.window_index, first))
        return max(float(plan.times[index]) - ADAPT_S, 0.0)

    def drop_until(self, plan: PlannedRun, moment: float) -> None:
        """Drop what a plan has driven by a moment [s].

        The rest begins at the speed reached there, and keeps its plan until more lines come.
        """
        rest = plan.after(moment)
        table = self.lookahead.table
        table.drop(plan.window_at(moment))
        if self._open is not None:
            # the part of the curve that is under way no longer changes
            under_way = len(self._open.chords) - len(table) + 1
            self._open = self._open.without(max(under_way, 0))
        first = rest.segments[0]
        if first.begin > table.segments[0].begin:
            # the rest of a segment under way, with the rest of its T
            now = table.segments[0].lasting_less(plan.spent(moment), first.feed_scale)
            table.replace(0, msgspec.structs.replace(now, begin=first.begin, opens=False))
        self.lookahead.entry = max(float(rest.phases.velocity[0]), 0.0)
        self.reserve = self.plan = rest

    def drop_reserve(self) -> PlannedRun:
        """Drop the segments that the reserve drives, and return it; the rest begins at rest.

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
        """Drop all segments; the next one begins at rest."""
        self.lookahead = Lookahead(self._limits)
        self._open = self.reserve = self.plan = None
