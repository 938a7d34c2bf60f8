"""Solve the velocity profile of a run: zero-acceleration knots, their speeds, and the phases between them.

A stretch between two knots is first solved without junction limits; where the result exceeds some, the lowest
of these becomes a knot and both sides are solved again. G93 segments are between knots of their own, since
each has its T.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.groups import Groups
from mcserver.motion.kernels.knots import SOLVED, find_knots
from mcserver.motion.kernels.sample_limits import Run
from mcserver.motion.kernels.timed_moves import EARLY, KEPT, LATE, timing_of_group
from mcserver.motion.limits.segment_table import SegmentTable
from mcserver.motion.profile.velocity_profile import join_phases

# Steps in which the speed at an end of a late segment is raised, as shares of the way to its limit.
RAISES = (0.1, 0.25, 0.5, 0.75, 1.0)
# Bisections between a speed at which a segment is late and one at which it is early.
HALVINGS = 12
# With more late segments than this, junctions between two late ones are not raised.
MOST_RAISED = 16


@dataclass(frozen=True)
class Solution:
    """Knots, their speeds, the velocity profile, and the held groups that miss their T.

    Attributes:
        speeds: at the groups' ends that are knots, NaN at others, shape (n+1,).
        phases: rows of `mcserver.motion.kernels.phases`. first: the first phase after each knot, and one
            past the last, shape (k,). late: held groups that take longer than their T, in order.
        early: held groups that end before it: the speeds at their ends leave no slower profile.
        run: the limits that it was solved within.
    """

    knots: NDArray[np.intp]
    speeds: Array
    phases: Array
    first: NDArray[np.intp]
    late: tuple[int, ...]
    early: tuple[int, ...]
    run: Run

    def times(self, edges: Array) -> Array:
        """Return the times at σ's ``edges`` (n+1,) [s]."""
        return join_phases(self.phases, float(edges[-1])).time_at(edges)


class KnotSolver:
    """Solver of one run.

    Args:
        table: its segments. groups: how they are planned, n of them.
        entry: speed at the beginning [m/s or rad/s along σ].

    Attributes:
        run: limits of the groups, set before each `solve`. durations: T of the groups, NaN without one,
            shape (n,) [s]. held: groups planned to take exactly their T, between knots, shape (n,).
        flow_vmax: speed limits of groups that are not held, but if faster would end before T, shape (n,).
    """

    def __init__(self, table: SegmentTable, groups: Groups, entry: float) -> None:
        self._table = table
        self._groups = groups
        self.durations = table.columns.duration[groups.starts]
        self.held = ~np.isnan(self.durations)
        self.flow_vmax = np.full(len(self.held), math.inf)
        self.run: Run
        self.entry = entry

    @property
    def first_line(self) -> int:
        """Number of the line under way."""
        return self._table.segments[0].line

    def nominal_speeds(self) -> Array:
        """Return junction speed limits, at held groups lowered to their mean speeds, shape (n+1,)."""
        speeds = self._groups.junction_vmax.copy()
        mean = np.where(self.held, self.means, math.inf)
        speeds[1:-1] = np.minimum(speeds[1:-1], np.minimum(mean[:-1], mean[1:]))
        return speeds

    @property
    def means(self) -> Array:
        """Mean speeds of groups by their T, NaN without one, shape (n,)."""
        return np.diff(self._groups.edges) / self.durations

    def solve(self, junction_vmax: Array) -> Solution:
        """Add knots until no stretch exceeds a speed limit, in each round at the lowest limit exceeded.

        Raises:
            PlanningError: no velocity profile keeps all limits.
        """
        durations = np.where(self.held, self.durations, math.nan)
        blamed = 0
        # with zero acceleration at a knot that only saves time there may be no profile from the entry speed:
        # then try without such knots
        for required_only in (False, True):
            first = self._initial_knots(junction_vmax)
            status, blamed, knots, speeds, phases, starts, timings = find_knots(
                self.run,
                self._groups.edges,
                junction_vmax,
                durations,
                first,
                self.entry,
                required_only,
            )
            if status == SOLVED:
                at_ends = np.full(len(junction_vmax), math.nan)
                at_ends[knots] = speeds
                return Solution(
                    knots,
                    at_ends,
                    phases,
                    np.append(starts, len(phases)),
                    tuple(knots[:-1][timings == LATE].tolist()),
                    tuple(knots[:-1][timings == EARLY].tolist()),
                    self.run,
                )
        raise PlanningError(self._table.segments[int(self._groups.starts[blamed])].line)

    def _initial_knots(self, junction_vmax: Array) -> NDArray[np.bool_]:
        """Return the initial knots: around held groups, and at stops."""
        is_knot = junction_vmax <= 0.0
        is_knot[0] = is_knot[-1] = True
        is_knot[:-1] |= self.held
        is_knot[1:] |= self.held
        return is_knot

    def _timing(self, index: int, speeds: Array) -> int:
        """Return the timing of a group between two speeds: `KEPT`, `LATE` or `EARLY`; `KEPT` if not held."""
        if not self.held[index]:
            return KEPT
        length = float(self._groups.edges[index + 1] - self._groups.edges[index])
        ends = (length, float(speeds[index]), float(speeds[index + 1]))
        return int(timing_of_group(self.run, index, ends, float(self.durations[index])))

    def raise_speeds(self, late: tuple[int, ...], speeds: Array, junction_vmax: Array) -> bool:
        """Raise junction speeds at the ends of late segments (D-33); return whether any was raised.

        The speed at a junction of two segments with a T is at first the lower of their mean speeds. A late
        segment may keep its T with more speed at its ends, if its neighbours still keep theirs.
        """
        changed = False
        most, now = self._groups.junction_vmax, speeds.copy()
        # many late segments are chords with too short a T, which `release_late` handles
        missed = set(late) if len(late) > MOST_RAISED else set()
        for index in late:
            for end, other in ((index, index - 1), (index + 1, index + 1)):
                if end in (0, len(self.held)) or other in missed or most[end] <= now[end] * (1.0 + 1e-9):
                    continue
                if self._timing(index, now) != LATE:
                    break
                before = now[end]
                now[end] = self._raised(index, other, end, now.copy())
                if now[end] > before:
                    junction_vmax[end] = now[end]
                    changed = True
        return changed

    def _raised(self, index: int, other: int, end: int, speeds: Array) -> float:
        """Return the speed at one end of a late segment at which it keeps its T, or is least late.

        Args:
            other: the segment beyond that end, which has to keep its T. speeds: scratch, overwritten.
        """
        low, high = float(speeds[end]), float(self._groups.junction_vmax[end])
        best, beyond = low, self._timing(other, speeds)

        def timing(speed: float) -> int | None:
            """Return the segment's timing; None: the other one would lose its T."""
            speeds[end] = speed
            then = self._timing(other, speeds)
            return self._timing(index, speeds) if then in (beyond, KEPT) else None

        for share in RAISES:
            speed = low + share * (high - low)
            found = timing(speed)
            if found == EARLY:
                best = self._between(best, speed, timing)
            if found != LATE:
                return speed if found == KEPT else best
            best = speed
        return best

    @staticmethod
    def _between(late: float, early: float, timing: Callable[[float], int | None]) -> float:
        """Bisect for the speed at which a segment keeps its T; failing that, return the greatest late one.

        Args:
            late, early: speeds at which it is late and early.
        """
        for _ in range(HALVINGS):
            middle = 0.5 * (late + early)
            found = timing(middle)
            if found == KEPT:
                return middle
            if found == LATE:
                late = middle
            else:
                early = middle
        return late

    def slow_down(
        self, early: Iterable[int], speeds: Array, junction_vmax: Array, which: tuple[int, ...]
    ) -> None:
        """Lower junction speeds at the ends of early segments until T is kept, or no profile is left.

        Args:
            which: ends to lower, 0 the first, 1 the second.
        """
        for index in early:
            ends = [index + each for each in which if 0 < index + each < len(self.held)]
            late, too_soon, now = 0.0, 1.0, speeds.copy()
            for _ in range(HALVINGS):
                share = 0.5 * (late + too_soon)
                now[ends] = share * speeds[ends]
                timing = self._timing(index, now)
                if timing == EARLY:
                    too_soon = share
                else:
                    late = share
                    if timing == KEPT:
                        too_soon = share
                        break
            junction_vmax[ends] = np.minimum(junction_vmax[ends], too_soon * speeds[ends])
