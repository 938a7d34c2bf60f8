"""Plans in which segments with a T of their own miss it: tried again with stops and with lower speeds beside
them (D-33).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.profile.profile_solver import KnotSolver, Solution

# Late segments of one window that stops are tried for.
MOST_STOPS = 8
# Times that speeds beside segments that would end before their T are lowered: what slows down one may leave
# another without a slower profile.
SLOWDOWNS = 4
# Share of the time of all that such a stop has to come below, where it lets no more lines keep their T.
STOP_GAIN = 0.8


def with_stops(solution: Solution, junction_vmax: Array, attempt: Callable[[Array], Solution]) -> Solution:
    """Try stops at vertices beside timed segments that are late, where that lets more of them keep their
    T, or as many and all of them together take much less time.

    A vertex that is passed with speed takes its part of the acceleration of the whole segment.
    """
    for group in list(solution.late)[:MOST_STOPS]:
        best: list[int] = []
        for ends in ((group,), (group + 1,), (group, group + 1)):
            inner = [end for end in ends if 0 < end < len(junction_vmax) - 1 and junction_vmax[end] > 0.0]
            if len(inner) < len(ends):
                continue
            other = _stopping(inner, junction_vmax, attempt)
            if other is None:
                continue
            late, time = _lateness(solution)
            if _lateness(other) < (late, time * STOP_GAIN):
                solution, best = other, inner
        junction_vmax[best] = 0.0
    return solution if len(solution.late) <= MOST_STOPS else _with_all_stops(solution, junction_vmax, attempt)


def none_early(
    solver: KnotSolver, solution: Solution, junction_vmax: Array, attempt: Callable[[Array], Solution]
) -> Solution:
    """Lower speeds beside timed segments that end before their T until none does, where that is possible.

    From the speed that is already there a segment may reach only speeds with which it ends too soon, or rest:
    under a jerk limit a change to a lower speed may take more room than a stop. Then it stops.
    """
    for _ in range(SLOWDOWNS):
        solver.slow_down(solution.early, solution.speeds, junction_vmax)
        try:
            found = attempt(junction_vmax)
        except PlanningError:
            # the speed that is there already leaves no other
            return solution
        if len(found.early) <= len(solution.early):
            solution = found
        if not solution.early:
            return solution
    for group in solution.early[:MOST_STOPS]:
        for end in (group + 1, group):
            if not 0 < end < len(junction_vmax) - 1:
                continue
            stopped = _stopping([end], junction_vmax, attempt)
            if stopped is not None and len(stopped.early) < len(solution.early):
                solution = stopped
                junction_vmax[end] = 0.0
                break
    return solution


def _stopping(ends: list[int], junction_vmax: Array, attempt: Callable[[Array], Solution]) -> Solution | None:
    """Return the plan with stops at these ends of groups; None where no plan exists."""
    trial = junction_vmax.copy()
    trial[ends] = 0.0
    try:
        return attempt(trial)
    except PlanningError:
        return None


def _lateness(solution: Solution) -> tuple[int, float]:
    """Return how many timed segments miss their T, and the time of all [s]."""
    return len(solution.late) + len(solution.early), float(solution.phases[:, 0].sum())


def _with_all_stops(
    solution: Solution, junction_vmax: Array, attempt: Callable[[Array], Solution]
) -> Solution:
    """Try stops at all the vertices beside timed segments that are late, of which there are many, at once:
    they are kept where the two segments take much less time from rest to rest.
    """
    late = np.array(list(solution.late))
    ends = np.unique(np.concatenate((late, late + 1)))
    ends = ends[(ends > 0) & (ends < len(junction_vmax) - 1)]
    ends = ends[junction_vmax[ends] > 0.0]
    trial = junction_vmax.copy()
    trial[ends] = 0.0
    try:
        resting = attempt(trial)
        rest = _times_about(resting, ends)
        kept = ends[rest < STOP_GAIN * _times_about(solution, ends)]
        if not len(kept):
            return solution
        trial = junction_vmax.copy()
        trial[kept] = 0.0
        found = attempt(trial)
    except PlanningError:
        return solution
    stops = trial
    best = min(found, resting, key=_lateness)
    if best is resting:
        stops = junction_vmax.copy()
        stops[ends] = 0.0
    best = _with_fewer_stops(best, stops, junction_vmax, attempt)
    return best if _lateness(best) < _lateness(solution) else solution


def _with_fewer_stops(
    solution: Solution, stops: Array, junction_vmax: Array, attempt: Callable[[Array], Solution]
) -> Solution:
    """Try to pass every other stop, then those between, twice: which vertices are better passed shows only
    where the ones beside them are not.
    """
    for turn in range(4):
        (closed,) = np.nonzero((stops == 0.0) & (junction_vmax > 0.0))
        closed = closed[turn % 2 :: 2]
        trial = stops.copy()
        trial[closed] = junction_vmax[closed]
        try:
            passed = attempt(trial)
            faster = closed[_times_about(passed, closed) < _times_about(solution, closed)]
            if not len(faster):
                continue
            trial = stops.copy()
            trial[faster] = junction_vmax[faster]
            found = attempt(trial)
        except PlanningError:
            continue
        if _lateness(found) < _lateness(solution):
            solution, stops = found, trial
    return solution


def _times_about(solution: Solution, ends: NDArray[np.intp]) -> Array:
    """Return the times of the two groups at each of some ends of groups [s]; NaN where they are not known."""
    passed = np.concatenate(([0.0], np.cumsum(solution.phases[:, 0])))[solution.first]
    place = np.minimum(np.searchsorted(solution.knots, (ends - 1, ends, ends + 1)), len(solution.knots) - 1)
    known = (solution.knots[place] == (ends - 1, ends, ends + 1)).all(axis=0)
    times: Array = np.where(known, passed[place[2]] - passed[place[0]], np.nan)
    return times
