"""Plan lines that cannot keep their T (D-33).

A line that takes longer than its T (late) is planned like a feed line: without knots of its own, at no more
than its mean speed where it would otherwise end before T. A line that would end before its T (early) may keep
it with lower speeds, or a stop, at its ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.timed_moves import SAME_TIME
from mcserver.motion.profile.profile_solver import KnotSolver, Solution

# Early segments of one window for which a stop is tried.
MOST_STOPS = 8
# Rounds in which junction speeds of early segments are lowered: slowing down one may make another early.
SLOWDOWNS = 4
# Plans in which late lines are released one after another; then all that have been released are limited to
# their mean speeds.
RELEASES = 6


def release_all(
    solver: KnotSolver, junction_vmax: Array, edges: Array, attempt: Callable[[Array], Solution]
) -> Solution:
    """Plan all lines like feed lines, early ones at no more than their mean speed.

    For an entry speed that leaves no plan with a knot at each end of a line with a T.

    Raises:
        PlanningError: it leaves no such plan either.
    """
    timed, solver.held = solver.held, np.zeros_like(solver.held)
    junction_vmax[:] = solver.nominal_speeds()
    solution = attempt(junction_vmax)
    limited, exempt = np.zeros_like(timed), 0
    for turn in range(RELEASES):
        early = timed & _missed(-np.diff(solution.times(edges)), -solver.durations)
        if not early.any():
            return solution
        if not (early & ~limited).any():
            break
        limited |= early if turn < RELEASES - 2 else timed
        solution, exempt = _plan_at_mean_speeds(solver, limited, exempt, lambda: attempt(junction_vmax))
    raise PlanningError(solver.first_line)


def _plan_at_mean_speeds(
    solver: KnotSolver, limited: NDArray[np.bool_], exempt: int, attempt: Callable[[], Solution]
) -> tuple[Solution, int]:
    """Plan with some lines limited to their mean speeds, except as few as possible at the beginning.

    Args:
        limited: these lines. exempt: number of lines at the beginning that may keep the entry speed.

    Returns:
        The plan, and the number of lines that were exempt.
    """
    while True:
        solver.flow_vmax = np.where(limited, solver.means, math.inf)
        np.copyto(solver.flow_vmax[:exempt], np.fmax(solver.means[:exempt], solver.entry))
        try:
            return attempt(), exempt
        except PlanningError:
            if exempt >= len(limited):
                raise
            exempt = max(2 * exempt, 1)


def release_late(
    solver: KnotSolver,
    solution: Solution,
    junction_vmax: Array,
    edges: Array,
    attempt: Callable[[Array], Solution],
) -> Solution:
    """Plan late lines like feed lines: with acceleration at their junctions, as fast as the axes allow.

    Those that would then end before their T are limited to their mean speed. Returns the given solution, with
    the solver as before, where no such plan exists.
    """
    free = np.zeros(len(solver.held), np.bool_)
    timed, held, held_speeds = solver.held.copy(), solution, junction_vmax.copy()
    for turn in range(RELEASES + 1):
        late = np.zeros(len(free), np.bool_)
        late[list(solution.late)] = True
        # releasing a line gains nothing if both of its neighbours are held, with knots at its ends
        unheld = late | ~solver.held
        late &= np.append(unheld[1:], False) | np.append(False, unheld[:-1])
        early = free & _missed(-np.diff(solution.times(edges)), -solver.durations)
        if turn == RELEASES and early.any():
            early = free.copy()
        if not (early.any() or (late.any() and turn < RELEASES)):
            break
        if turn < RELEASES:
            free |= late
            solver.held = solver.held & ~late
        free &= ~early
        solver.flow_vmax = np.where(early, solver.means, solver.flow_vmax)
        nominal, opened = solver.nominal_speeds(), np.append(late, False) | np.append(False, late)
        # keep stops, and speeds that `raise_speeds` has raised
        np.copyto(junction_vmax, nominal, where=opened & (junction_vmax > 0.0) & (junction_vmax < nominal))
        try:
            solution = attempt(junction_vmax)
        except PlanningError:
            # no other plan from the entry speed
            solver.held, solver.flow_vmax = timed, np.full(len(free), math.inf)
            junction_vmax[:] = held_speeds
            return held
    return solution


def late_groups(solver: KnotSolver, times: Array) -> list[int]:
    """Return the groups that take longer than their T.

    Args:
        times: at the groups' ends, shape (n+1,) [s].
    """
    late: list[int] = np.nonzero(_missed(np.diff(times), solver.durations))[0].tolist()
    return late


def _missed(took: Array, durations: Array) -> NDArray[np.bool_]:
    """Return which groups take longer than their T; False where T is NaN."""
    beyond: NDArray[np.bool_] = took > durations + SAME_TIME * (1.0 + 2.0 * np.abs(durations))
    return beyond


def slow_early(
    solver: KnotSolver,
    solution: Solution,
    junction_vmax: Array,
    edges: Array,
    attempt: Callable[[Array], Solution],
) -> Solution:
    """Lower junction speeds of early segments until none is early, as far as possible.

    Under a jerk limit a change to a lower speed may need more distance than a stop: then stops are tried.
    A released line beside them that would then be early is limited to its mean speed.
    """
    solution = _lower_ends(solver, solution, junction_vmax, attempt)
    free = ~solver.held & np.isfinite(solver.durations)
    early = free & _missed(-np.diff(solution.times(edges)), -solver.durations)
    if early.any():
        unlimited, solver.flow_vmax = solver.flow_vmax, np.where(early, solver.means, solver.flow_vmax)
        try:
            return attempt(junction_vmax)
        except PlanningError:
            solver.flow_vmax = unlimited
    return solution


def _lower_ends(
    solver: KnotSolver, solution: Solution, junction_vmax: Array, attempt: Callable[[Array], Solution]
) -> Solution:
    for _ in range(SLOWDOWNS):
        found = _slower(solver, solution, junction_vmax, attempt)
        if found is None:
            break
        solution = found
        if not solution.early:
            return solution
    for group in solution.early[:MOST_STOPS]:
        for end in (group + 1, group):
            if not 0 < end < len(junction_vmax) - 1:
                continue
            stopped = _stopping(end, junction_vmax, attempt)
            if stopped is not None and len(stopped.early) < len(solution.early):
                solution = stopped
                junction_vmax[end] = 0.0
                break
    return solution


def _slower(
    solver: KnotSolver, solution: Solution, junction_vmax: Array, attempt: Callable[[Array], Solution]
) -> Solution | None:
    """Return a plan with lower junction speeds at the ends of early segments, and no more of these.

    The entry speed may leave no plan with both ends lowered, but one with the second end alone.

    Returns:
        None, with the junction speeds as before, where there is no such plan.
    """
    for ends in (0, 1), (1,), (0,):
        trial = junction_vmax.copy()
        solver.slow_down(solution.early, solution.speeds, trial, ends)
        try:
            found = attempt(trial)
        except PlanningError:
            continue
        if len(found.early) <= len(solution.early):
            junction_vmax[:] = trial
            return found
    return None


def _stopping(end: int, junction_vmax: Array, attempt: Callable[[Array], Solution]) -> Solution | None:
    """Return the plan with a stop at an end of a group; None where no plan exists."""
    trial = junction_vmax.copy()
    trial[end] = 0.0
    try:
        return attempt(trial)
    except PlanningError:
        return None
