"""What of a motion is committed, kept for as long as the executor has not come to it: it can be planned anew
from a moment in it.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from mcserver.motion.geometry.segment import Segment
from mcserver.motion.lookahead.commit_moments import LEAST_PHASE_S, commit_moment, turn_moment
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.segment_table import FirstSegments, SegmentTable
from mcserver.motion.run_output import edges_before

# Stretches that are kept: more are not ahead of the executor, whatever the ring holds.
MOST_KEPT = 64


@dataclass(frozen=True)
class Stretch:
    """What was committed at one time, from the beginning of a plan to a moment in it.

    Attributes:
        origin, end: on the program's time axis [cycles]. plan, until: the plan, and that moment [s].
        entry: speed at its beginning, along σ. pace, plain: as of `Pace` [1]. cycle: of the machine [s].
        feed_scale: that it was planned for. dropped: segments that ended with it. cut: the one that did
            not, as it was before.
    """

    origin: float
    end: float
    plan: PlannedRun
    until: float
    entry: float
    pace: float
    plain: float
    feed_scale: float
    cycle: float
    dropped: FirstSegments
    cut: Segment

    @property
    def rows_a_second(self) -> float:
        """As they are planned [1/s]."""
        return self.pace / self.cycle


@dataclass(frozen=True)
class Cut:
    """A moment from which a motion can be planned anew.

    Attributes:
        kept: the stretches before that of the cut. stretch: that one. moment: in its plan [s].
        behind: the stretches that follow it. instead: only if one inside of a line with a time of its own
            does not do.
    """

    kept: tuple[Stretch, ...]
    stretch: Stretch
    moment: float
    behind: tuple[Stretch, ...]
    instead: bool = False

    @property
    def u(self) -> float:
        """Where it is on the program's time axis [cycles]."""
        return self.stretch.origin + self.moment * self.stretch.rows_a_second

    def table(self, present: SegmentTable) -> SegmentTable | None:
        """Return the segments of the window as they stood before the stretch, with those that have come
        since; None where one that is under way has become another.

        Args:
            present: those of the window now.
        """
        table = present
        for stretch in reversed((self.stretch, *self.behind)):
            if not table or not _is_part(table.segments[0], stretch.cut):
                return None
            table = table.behind(stretch.dropped, stretch.cut, stretch.plan.spent(stretch.until))
        # the one under way may be planned for another feed scale by now
        table.set_feed_scale(self.stretch.cut.feed_scale)
        return table

    def slower_behind(self, scale: float) -> float:
        """Return how much behind it was planned for less than a feed scale [cycles]."""
        stretches = (dataclasses.replace(self.stretch, origin=self.u), *self.behind)
        return sum(each.end - each.origin for each in stretches if each.feed_scale < scale)

    @property
    def edges_behind(self) -> int:
        """Line starts and ends behind it that were put out."""
        put = sum(edges_before(each.plan, each.until) for each in (self.stretch, *self.behind))
        return put - edges_before(self.stretch.plan, self.moment)

    @property
    def bound_behind(self) -> frozenset[int]:
        """Lines that end behind it, of which it was said what bounds them."""
        since = self.moment
        lines: set[int] = set()
        for stretch in (self.stretch, *self.behind):
            times = stretch.plan.times[1:]
            for index in np.flatnonzero((times > since) & (times <= stretch.until)).tolist():
                if stretch.plan.bound_by[index] is not None:
                    lines.add(stretch.plan.segments[index].line)
            since = 0.0
        return frozenset(lines)

    @property
    def fastest_pace(self) -> float:
        """The greatest pace of what is behind it."""
        return max(each.pace for each in (self.stretch, *self.behind))


class Committed:
    """The stretches of the motion under way, in order, without a gap."""

    def __init__(self, stretches: tuple[Stretch, ...] = ()) -> None:
        self._stretches = deque(stretches, MOST_KEPT)

    def add(self, stretch: Stretch) -> None:
        """Note what is committed next."""
        self._stretches.append(stretch)

    def clear(self) -> None:
        """Note that the motion has ended, or that what comes next cannot be planned anew."""
        self._stretches.clear()

    def forget(self, u: float) -> None:
        """Forget what lies before u."""
        while self._stretches and self._stretches[0].end <= u:
            self._stretches.popleft()

    def slower_behind(self, u: float, scale: float) -> bool:
        """Return whether something behind u was planned for less than a feed scale."""
        return any(each.end > u and each.feed_scale < scale for each in self._stretches)

    def cuts_at(self, u: float, *, at_turns: bool) -> list[Cut]:
        """Return the first moments at or behind u from which the motion can be planned anew.

        That is where it may be committed up to, or inside of a line with a time of its own, and instead at
        its end. None where that is the end of what is committed.

        Args:
            at_turns: also a moment before that, inside of a stretch that is solved as a whole, where speed
                turns from rising to falling or back.
        """
        stretches = tuple(self._stretches)
        cuts: list[Cut] = []
        for index, stretch in enumerate(stretches):
            if stretch.end <= u:
                continue
            moments, instead = [0.0], math.inf
            if stretch.origin < u:
                wanted = (u - stretch.origin) / stretch.rows_a_second
                first, moment = (_moment_of(stretch, wanted, inside_timed=each) for each in (True, False))
                # one with the moment itself but for rounding is no other
                until = min(first, stretch.until) - LEAST_PHASE_S
                moments = [turn_moment(stretch.plan, wanted, until) if at_turns else math.inf, first]
                instead = moment if moment > first else math.inf
            cuts += [
                Cut(stretches[:index], stretch, each, stretches[index + 1 :], instead=each == instead)
                for each in (*moments, instead)
                if math.isfinite(each)
            ]
            if math.isfinite(moments[-1]):
                break
        return cuts


def _moment_of(stretch: Stretch, wanted: float, *, inside_timed: bool) -> float:
    """Return the first time at or after one at which a stretch may be committed up to [s]; infinite without
    one. See `commit_moment`.
    """
    found = commit_moment(stretch.plan, wanted, at_peaks=True, inside_timed=inside_timed)
    moment = stretch.plan.at_end(found)
    return moment if wanted <= moment < stretch.until else math.inf


def _is_part(segment: Segment, of: Segment) -> bool:
    """Return whether a segment is what is left of another one."""
    same = segment.line == of.line and segment.scale == of.scale and segment.straight == of.straight
    return same and all(
        np.array_equal(a, b)
        for a, b in ((segment.first, of.first), (segment.last, of.last), (segment.base, of.base))
    )
