"""The velocity profile of a run: speeds at its zero-acceleration knots, and the profiles between them.

Acceleration is zero at knots. They are found by the caps that bind: a stretch between two knots is solved as
if nothing bound it; where the result passes a cap, the lowest such cap becomes a knot and both sides are
solved again. Segments of G93 stand between knots of their own, since each has its T.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import Bound, PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.kernels.groups import Groups
from mcserver.motion.kernels.knots import SOLVED, find_knots
from mcserver.motion.lookahead.path_limits import RunLimits
from mcserver.motion.lookahead.segment_table import SegmentTable
from mcserver.motion.profile.speed_ramps import min_time_profiles, profiles_in_time
from mcserver.motion.profile.velocity_profile import Profile, ProfileSolver, rows_of

# Shares of the greatest speed at an end of a late segment that are tried for it, and halvings between the
# last with which it is late and the first with which it ends too soon.
RAISES, HALVINGS = (0.1, 0.25, 0.5, 0.75, 1.0), 12
# Rounding of a T.
SAME_TIME = 1e-9


class Timing(Enum):
    """How a timed segment can be passed between two speeds: its T may be out of reach on either side."""

    KEPT = 0
    LATE = 1
    EARLY = 2


@dataclass(frozen=True)
class Solution:
    """Knots, their speeds, the velocity profile, and the limits that stretched timed segments.

    Attributes:
        phases: rows of `mcserver.motion.kernels.phases`. first: the first phase behind each knot, and one
            past the last, shape (k,). late: timed groups that take longer than their T, in order, and why.
        early: those that end before it, since the speeds at their ends leave no slower profile.
    """

    knots: NDArray[np.intp]
    speeds: dict[int, float]
    phases: Array
    first: NDArray[np.intp]
    late: dict[int, Bound]
    early: tuple[int, ...] = ()


class KnotSolver:
    """Solver of one run.

    Args:
        table: its segments. groups: how they are planned, n of them.
        entry: speed at the beginning [m/s or rad/s along σ].

    Attributes:
        run: limits of the groups, set before each `solve`.
    """

    def __init__(
        self, solver: ProfileSolver, limits: AxisLimits, table: SegmentTable, groups: Groups, entry: float
    ) -> None:
        self._solver = solver
        self._limits = limits
        self._table = table
        self._groups = groups
        self._timed = table.timed[groups.starts]
        self._has_timed = bool(self._timed.any())
        self.run: RunLimits
        self._entry = entry

    def solve(self, junction_vmax: Array) -> Solution:
        """Add knots until no stretch exceeds a speed limit; each round binds the lowest one that each
        stretch exceeds.

        Raises:
            PlanningError: no velocity profile keeps all limits.
        """
        found, knot_speeds, phases, first = self._found(junction_vmax)
        knots = found.tolist()
        speeds = dict(zip(knots, knot_speeds.tolist(), strict=True))
        if not self._has_timed:
            return Solution(found, speeds, phases, np.append(first, len(phases)), {})
        # stretches with a time of their own between those without
        parts: list[Array] = []
        late: dict[int, Bound] = {}
        early: list[int] = []
        ends = [*first.tolist(), len(phases)]
        for index, (left, right) in enumerate(pairwise(knots)):
            if ends[index] < 0:
                profiles, timing = self._in_time(left, speeds[left], speeds[right])
                if timing is Timing.LATE:
                    late[left] = self._bound_of(left, profiles)
                elif timing is Timing.EARLY:
                    early.append(left)
                parts.append(rows_of(profiles, float(self._groups.edges[left])))
            else:
                until = next(end for end in ends[index + 1 :] if end >= 0)
                parts.append(phases[ends[index] : until])
        offsets = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
        return Solution(found, speeds, np.concatenate(parts), offsets, late, tuple(early))

    def _found(self, junction_vmax: Array) -> tuple[NDArray[np.intp], Array, Array, NDArray[np.intp]]:
        """Return knots, their speeds, phases and where these begin, as `find_knots` gives them."""
        blamed = 0
        # a knot asks for zero acceleration: one that was to save time may leave no way from the speed that is
        # already there, so without such knots it is tried again
        for required_only in (False, True):
            first = self._initial_knots(junction_vmax, hints=not required_only)
            status, blamed, knots, speeds, phases, starts = find_knots(
                self.run.run,
                self._groups.edges,
                junction_vmax.copy(),
                self._timed,
                first,
                self._entry,
                required_only,
            )
            if status == SOLVED:
                return knots, speeds, phases, starts
        raise PlanningError(self._segment(blamed).line)

    def _initial_knots(self, junction_vmax: Array, *, hints: bool) -> NDArray[np.bool_]:
        """Return the knots known from the outset: about timed segments, at stops, and by ``hints`` those
        of the last plan.
        """
        is_knot = junction_vmax <= 0.0
        is_knot[0] = is_knot[-1] = True
        is_knot[:-1] |= self._timed
        is_knot[1:] |= self._timed
        if hints:
            is_knot[:-1] |= self._table.columns.knot_edges[self._groups.starts] & self._groups.bits != 0
        return is_knot

    def _segment(self, group: int) -> Segment:
        return self._table.segments[int(self._groups.starts[group])]

    def _in_time(self, index: int, entry: float, exit_: float) -> tuple[list[Profile], Timing]:
        """Plan one G93 segment: T to the rounding error where the limits allow it, else as short as they
        allow.
        """
        segment = self._segment(index)
        assert segment.duration is not None
        quickest: list[Profile] | None = None
        # speeds at knots are those that can be joined with or without the rows of vertices
        tables = [self.run.limit_table(index, index + 1, speed) for speed in (0.0, math.inf)]
        for table in tables[: 1 + (tables[0] != tables[1])]:
            kept = profiles_in_time(self._solver, segment.extent, entry, exit_, table, segment.duration)
            if kept is not None:
                return kept, Timing.KEPT
            quickest = quickest or min_time_profiles(segment.extent, entry, exit_, table)
        if quickest is None:
            raise PlanningError(segment.line)
        least = sum(part.duration for part in quickest)
        early = least < segment.duration * (1.0 - SAME_TIME)
        return quickest, Timing.EARLY if early else Timing.LATE

    def _timing(self, index: int, speeds: dict[int, float]) -> Timing:
        """Return how a segment can be passed between these speeds; one without T keeps it."""
        if self._segment(index).duration is None:
            return Timing.KEPT
        try:
            return self._in_time(index, speeds[index], speeds[index + 1])[1]
        except PlanningError:
            return Timing.LATE

    def raise_speeds(self, late: Iterable[int], speeds: dict[int, float], junction_vmax: Array) -> bool:
        """Raise speeds at the ends of timed segments that take longer than their T (D-33).

        The speed at a joint of two timed segments is at first the lower of their means. A segment that cannot
        keep its T so may with more speed at its ends, if the neighbours keep theirs. True if a cap was
        changed.
        """
        changed = False
        junction_vmax_hard = self._groups.junction_vmax_hard
        now = dict(speeds)
        for index in late:
            for end, other in ((index, index - 1), (index + 1, index + 1)):
                if end in (0, len(self._timed)) or junction_vmax_hard[end] <= now[end] * (1.0 + 1e-9):
                    continue
                if self._timing(index, now) is not Timing.LATE:
                    break
                best = self._raised(index, other, end, now)
                if best > now[end]:
                    now[end] = best
                    junction_vmax[end] = best
                    changed = True
        return changed

    def _raised(self, index: int, other: int, end: int, speeds: dict[int, float]) -> float:
        """Return the speed at one end of a late segment with which it keeps its T, or is least late.

        Args:
            other: the segment beyond that end, which is not to lose its own T.
        """
        low, high = speeds[end], float(self._groups.junction_vmax_hard[end])
        best, beyond = low, self._timing(other, speeds)

        def timing(speed: float) -> Timing | None:
            """Return how the segment is passed; None: the other one loses its T."""
            trial = {**speeds, end: speed}
            then = self._timing(other, trial)
            if then is not beyond and then is not Timing.KEPT:
                return None
            return self._timing(index, trial)

        for share in RAISES:
            speed = low + share * (high - low)
            found = timing(speed)
            if found is Timing.EARLY:
                best = self._between(best, speed, timing)
            if found is not Timing.LATE:
                return speed if found is Timing.KEPT else best
            best = speed
        return best

    @staticmethod
    def _between(late: float, early: float, timing: Callable[[float], Timing | None]) -> float:
        """Return a speed with which a segment keeps its T, between one with which it is late and one with
        which it is early; failing that, the greatest with which it is late.
        """
        for _ in range(HALVINGS):
            middle = 0.5 * (late + early)
            found = timing(middle)
            if found is Timing.KEPT:
                return middle
            if found is Timing.LATE:
                late = middle
            else:
                early = middle
        return late

    def slow_down(self, early: Iterable[int], speeds: dict[int, float], junction_vmax: Array) -> None:
        """Lower the speeds at the ends of timed segments that end before their T until T is kept, or until
        the speeds cannot be joined.
        """
        for index in early:
            ends = [end for end in (index, index + 1) if 0 < end < len(self._timed)]
            late, too_soon = 0.0, 1.0
            for _ in range(HALVINGS):
                share = 0.5 * (late + too_soon)
                timing = self._timing(index, {**speeds, **{end: share * speeds[end] for end in ends}})
                if timing is Timing.EARLY:
                    too_soon = share
                else:
                    late = share
                    if timing is Timing.KEPT:
                        too_soon = share
                        break
            for end in ends:
                junction_vmax[end] = min(junction_vmax[end], too_soon * speeds[end])

    def _bound_of(self, index: int, profiles: list[Profile]) -> Bound:
        limit_table = self.run.limit_table(index, index + 1)
        first = int(self._groups.starts[index])
        peak = max(part.peak_velocity for part in profiles)
        if peak >= 0.999 * limit_table[-1].velocity:
            limit = self._table.limit_of(first)
            return self._limits.bound(limit.column, limit.kind)
        _, most_acceleration, most_jerk = self._limits.of_samples
        slope = self._table.samples_of(first)[:, : len(most_jerk)].max(axis=0)
        with np.errstate(divide="ignore"):
            by_acceleration = most_acceleration / np.maximum(slope, 1e-300)
            by_jerk = most_jerk / np.maximum(slope, 1e-300)
        strongest = max(part.peak_acceleration for part in profiles)
        if strongest >= 0.999 * min(level.acceleration for level in limit_table):
            return self._limits.bound(int(np.argmin(by_acceleration)), "acceleration")
        return self._limits.bound(int(np.argmin(by_jerk)), "jerk")
