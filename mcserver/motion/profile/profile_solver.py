"""The velocity profile of a run: speeds at its zero-acceleration knots, and the profiles between them.

Acceleration is zero at knots. They are found by the caps that bind: a stretch between two knots is solved as
if nothing bound it; where the result passes a cap, the lowest such cap becomes a knot and both sides are
solved again. Segments of G93 stand between knots of their own, since each has its T.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import Bound, PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.kernels.groups import Groups
from mcserver.motion.kernels.knots import SOLVED, find_knots
from mcserver.motion.lookahead.path_limits import AccelerationLimit, RunLimits
from mcserver.motion.lookahead.segment_table import SegmentTable
from mcserver.motion.profile.speed_ramps import min_time_profiles, profiles_in_time
from mcserver.motion.profile.velocity_profile import Profile, ProfileSolver, rows_of


@dataclass(frozen=True)
class Solution:
    """Knots, their speeds, the velocity profile, and the limits that stretched timed segments.

    Attributes:
        phases: rows of `mcserver.motion.kernels.phases`. first: the first phase behind each knot, and one
            past the last, shape (k,). late: timed groups that take longer than their T, in order, and why.
    """

    knots: NDArray[np.intp]
    speeds: dict[int, float]
    phases: Array
    first: NDArray[np.intp]
    late: dict[int, Bound]


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
        ends = [*first.tolist(), len(phases)]
        for index, (left, right) in enumerate(pairwise(knots)):
            if ends[index] < 0:
                profiles, bound = self._in_time(left, speeds[left], speeds[right])
                if bound is not None:
                    late[left] = bound
                parts.append(rows_of(profiles, float(self._groups.edges[left])))
            else:
                until = next(end for end in ends[index + 1 :] if end >= 0)
                parts.append(phases[ends[index] : until])
        offsets = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
        return Solution(found, speeds, np.concatenate(parts), offsets, late)

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

    def _in_time(self, index: int, entry: float, exit_: float) -> tuple[list[Profile], Bound | None]:
        """Plan one G93 segment: T to the rounding error where the limits allow it, else as short as they
        allow.
        """
        segment = self._segment(index)
        assert segment.duration is not None
        limit_table = self.run.limit_table(index, index + 1)
        kept = profiles_in_time(self._solver, segment.extent, entry, exit_, limit_table, segment.duration)
        if kept is not None:
            return kept, None
        quickest = min_time_profiles(segment.extent, entry, exit_, limit_table)
        if quickest is None:
            raise PlanningError(segment.line)
        return quickest, self._bound_of(index, quickest, limit_table)

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
                if not self._timed_overrun(index, now):
                    break
                low, high = now[end], float(junction_vmax_hard[end])
                best = low
                for share in (0.1, 0.25, 0.5, 0.75, 1.0):
                    trial = {**now, end: low + share * (high - low)}
                    if self._timed_overrun(other, trial) and not self._timed_overrun(other, now):
                        break
                    best = trial[end]
                    if not self._timed_overrun(index, trial):
                        break
                if best > low:
                    now[end] = best
                    junction_vmax[end] = best
                    changed = True
        return changed

    def _timed_overrun(self, index: int, speeds: dict[int, float]) -> bool:
        """Return whether a timed segment cannot keep its T between these speeds; False for one without T."""
        segment = self._segment(index)
        if segment.duration is None:
            return False
        kept = profiles_in_time(
            self._solver,
            segment.extent,
            speeds[index],
            speeds[index + 1],
            self.run.limit_table(index, index + 1),
            segment.duration,
        )
        return kept is None

    def _bound_of(self, index: int, profiles: list[Profile], limit_table: list[AccelerationLimit]) -> Bound:
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
