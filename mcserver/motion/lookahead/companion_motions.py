"""Motions of the companion groups of comma lines, in a window and under way (D-32)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcserver.motion.bound import PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import Segment
from mcserver.motion.geometry.segment_rows import SegmentRows
from mcserver.motion.lookahead.leading_group import Companions
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.setpoint_sampling import CYCLE_ROUNDING, first_row, put_end, put_sample
from mcserver.motion.pieces import Rows

# Longest that a companion may last beyond its line, through rounding [s].
ROUNDING_S = 1e-7
# Difference of unit tangents below which a junction is straight.
STRAIGHT = 1e-9
# A line that would end before its companions is lengthened by this multiple of the shortfall,
MORE_TIME = 1.05
# at most so many times.
TRIES = 6


@dataclass(frozen=True)
class LineShortfall:
    """A line that would end before its companions, and by how much [s]."""

    line: int
    missing: float


@dataclass
class _UnderWay:
    """Companions whose line has begun, and where it begins and ends on the time axis [cycles]."""

    line: int
    companions: Companions
    start: float
    end: float


@dataclass(frozen=True)
class _Ends:
    """The columns of a line's segment, and its tangents at start and end, shape (K,)."""

    mask: int
    first: Array
    last: Array


class CompanionMotions:
    """The companions of the comma lines in a window, and of the line under way.

    Attributes:
        cycle: between rows [s].
    """

    def __init__(self, cycle: float) -> None:
        self.cycle = cycle
        self._known: dict[int, Companions] = {}
        self._begun: list[_UnderWay] = []
        # masks of the columns of leading groups and of companions since the motion last rested
        self._leading = self._beside = 0
        # tangent at the end of the last line, shape (K,), and whether its companions set its time
        self._before: Array | None = None
        self._set_time = False

    @property
    def present(self) -> bool:
        """Whether a line in the window, or the line under way, has companions."""
        return bool(self._known) or any(math.isinf(each.end) for each in self._begun)

    def begins_at_rest(self, segment: Segment, companions: Companions | None, *, from_rest: bool) -> bool:
        """Add a line to the window; return whether the motion has to rest before it.

        It has to where a column changes between a leading group and a companion: companions begin and end at
        rest, and no blend may move them. It has to also before a turn, if the companions set the time of the
        line on either side: a blend would take from that time and save none.

        Args:
            segment: of its leading group. from_rest: whether it rests there anyway.
        """
        if companions is not None:
            self._known[segment.line] = companions
        return self._take(_Ends(segment.mask, segment.first, segment.last), companions, from_rest)

    def run_begins_at_rest(self, run: SegmentRows, *, from_rest: bool) -> bool:
        """Add a batch of lines without companions to the window, as `begins_at_rest` does one line."""
        return self._take(_Ends(run.mask, run.ends[0, 0], run.ends[-1, 1]), None, from_rest)

    def _take(self, ends: _Ends, companions: Companions | None, from_rest: bool) -> bool:
        beside, set_time = (0, False) if companions is None else (companions.mask, companions.set_time)
        rests = from_rest or bool(ends.mask & self._beside or beside & self._leading)
        if self._before is not None and (set_time or self._set_time):
            rests = rests or _turn(self._before, ends.first) > STRAIGHT
        if rests:
            self._leading = self._beside = 0
        self._leading |= ends.mask
        self._beside |= beside
        self._before, self._set_time = ends.last, set_time
        return rests

    def closed(self) -> None:
        """Note that the window has ended at rest."""
        self._leading = self._beside = 0
        self._before, self._set_time = None, False

    def unfinished(self, plan: PlannedRun, origin: float) -> LineShortfall | None:
        """Return the first line that a plan ends before its companions, or None.

        Args:
            origin: where the plan starts on the time axis [cycles].
        """
        if not self._known and not self._begun:
            return None
        starts = {each.line: (each.start - origin) * self.cycle for each in self._begun}
        times = plan.times.tolist()
        for index, segment in enumerate(plan.segments):
            if segment.opens and segment.line in self._known:
                starts[segment.line] = times[index]
            if segment.closes and segment.line in starts:
                missing = self._of(segment.line).duration - (times[index + 1] - starts[segment.line])
                if missing > ROUNDING_S:
                    return LineShortfall(segment.line, missing)
        return None

    def last_to_end(self, window: Lookahead, plan: PlannedRun, origin: float) -> PlannedRun:
        """Return a plan of a window in which no comma line ends before its companions.

        A plan may end a line before its T, where the speeds at its ends leave no slower profile. Such a line
        gets a longer T, and the window is planned again.

        Args:
            plan: of the window. origin: where it starts on the time axis [cycles].

        Raises:
            PlanningError: no such plan was found.
        """
        for _ in range(TRIES):
            early = self.unfinished(plan, origin)
            if early is None:
                return plan
            window.lengthen(early.line, MORE_TIME * early.missing)
            plan = window.plan()
        early = self.unfinished(plan, origin)
        if early is not None:
            raise PlanningError(early.line)
        return plan

    def _of(self, line: int) -> Companions:
        if line in self._known:
            return self._known[line]
        return next(each.companions for each in self._begun if each.line == line)

    def begin(self, plan: PlannedRun, origin: float, until: float, last: int) -> None:
        """Note which lines begin and end in the part of a plan that is handed over.

        A line whose companions set its time gets their bound.

        Args:
            origin: where the plan starts on the time axis [cycles].
            until: end of the part [s]; infinite: all of it, and rows up to ``last``.
        """
        self._begun = [each for each in self._begun if math.isinf(each.end)]
        if not self._known and not self._begun:
            return
        times = plan.times.tolist()
        for index, segment in enumerate(plan.segments):
            if times[index] >= until:
                break
            if segment.opens and segment.line in self._known:
                start = origin + times[index] / self.cycle
                self._begun.append(_UnderWay(segment.line, self._known.pop(segment.line), start, math.inf))
            if segment.closes and times[index + 1] <= until:
                for each in self._begun:
                    if each.line == segment.line:
                        each.end = origin + times[index + 1] / self.cycle
                        if each.companions.set_time and plan.bound_by[index] is None:
                            plan.bound_by[index] = each.companions.bound
        if math.isinf(until):
            for each in self._begun:
                if each.line == plan.segments[-1].line:
                    # rows up to the whole cycle at which the motion rests
                    each.end = max(each.end, float(last))

    def put_on(self, rows: Rows) -> None:
        """Write the companions' motion into rows of the leading groups."""
        for each in self._begun:
            low = max(rows.first, first_row(each.start))
            high = rows.first + len(rows.line) - 1
            if math.isfinite(each.end):
                high = min(high, math.floor(each.end + CYCLE_ROUNDING))
            if low > high:
                continue
            at = slice(low - rows.first, high - rows.first + 1)
            for run in each.companions.runs:
                put_sample(run, each.start, low, high, self.cycle, rows.position[at], rows.velocity[at])

    def put_ends_on(self, position: Array, line: int) -> None:
        """Write the companions' end positions into the position (K,) at a line's end."""
        for each in self._begun:
            if each.line == line:
                for run in each.companions.runs:
                    put_end(run, position)


def _turn(before: Array, after: Array) -> float:
    """Return the length of the difference of two unit tangents."""
    step = after / np.linalg.norm(after) - before / np.linalg.norm(before)
    return float(np.linalg.norm(step))
