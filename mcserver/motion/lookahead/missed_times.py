"""Plans in which segments with a T of their own miss it (D-33): those that cannot keep it flow on as feed
lines do; lower speeds beside those that would end before it, or a stop, may let them keep theirs.
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

# Segments of one window that end before their T and that stops are tried for.
MOST_STOPS = 8
# Times that speeds beside segments that would end before their T are lowered: what slows down one may leave
# another without a slower profile.
SLOWDOWNS = 4
# Plans in which lines that cannot keep their T are told from those that can, before all of the former keep
# to their mean speeds.
RELEASES = 6


def flowing(
    solver: KnotSolver, junction_vmax: Array, edges: Array, attempt: Callable[[Array], Solution]
) -> Solution:
    """Let all lines flow into each other as feed lines do, those that would end before their T by that at no
    more than their mean speed: the speed that is there already may leave no plan in which each begins and
    ends without acceleration.

    Raises:
        PlanningError: that speed leaves no such plan either.
    """
    timed, solver.held = solver.held, np.zeros_like(solver.held)
    junction_vmax[:] = solver.nominal_speeds()
    solution = attempt(junction_vmax)
    kept, falling = np.zeros_like(timed), 0
    for turn in range(RELEASES):
        early = timed & _missed(-np.diff(solution.times(edges)), -solver.durations)
        if not early.any():
            return solution
        if not (early & ~kept).any():
            break
        kept |= early if turn < RELEASES - 2 else timed
        solution, falling = _at_means(solver, kept, falling, lambda: attempt(junction_vmax))
    raise PlanningError(solver.first_line)


def _at_means(
    solver: KnotSolver, kept: NDArray[np.bool_], falling: int, attempt: Callable[[], Solution]
) -> tuple[Solution, int]:
    """Plan with some lines at no more than their mean speeds, but for as many at the beginning as it takes.

    Args:
        kept: which. falling: how many at the beginning may be as fast as the motion is already.

    Returns:
        The plan, and how many those were.
    """
    while True:
        solver.flow_vmax = np.where(kept, solver.means, math.inf)
        np.copyto(solver.flow_vmax[:falling], np.fmax(solver.means[:falling], solver.entry))
        try:
            return attempt(), falling
        except PlanningError:
            if falling >= len(kept):
                raise
            falling = max(2 * falling, 1)


def released(
    solver: KnotSolver,
    solution: Solution,
    junction_vmax: Array,
    edges: Array,
    attempt: Callable[[Array], Solution],
) -> Solution:
    """Let late lines flow into each other as feed lines do: with acceleration where they meet, as fast as
    the axes allow, and those that would end before their T by that at no more than their mean speed.
    """
    free = np.zeros(len(solver.held), np.bool_)
    timed, held, held_speeds = solver.held.copy(), solution, junction_vmax.copy()
    for turn in range(RELEASES + 1):
        late = np.zeros(len(free), np.bool_)
        late[list(solution.late)] = True
        # one that nothing flows into, between knots, is as quick as it can be
        flows = late | ~solver.held
        late &= np.append(flows[1:], False) | np.append(False, flows[:-1])
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
        # speeds that were raised stay, and stops
        np.copyto(junction_vmax, nominal, where=opened & (junction_vmax > 0.0) & (junction_vmax < nominal))
        try:
            solution = attempt(junction_vmax)
        except PlanningError:
            # the speed that is there already leaves no other
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
    """Return which times are beyond those asked for; not where none is asked for."""
    beyond: NDArray[np.bool_] = took > durations + SAME_TIME * (1.0 + 2.0 * np.abs(durations))
    return beyond


def none_early(
    solver: KnotSolver, solution: Solution, junction_vmax: Array, attempt: Callable[[Array], Solution]
) -> Solution:
    """Lower speeds beside timed segments that end before their T, until none does, where that is possible.

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
