"""Where a plan may be cut: moments without acceleration before its stop, from which it goes on anew."""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.profile.velocity_profile import Phases

# Where speed is never steady until so much later than wanted, a moment at which it has a peak will do: a feed
# override finds less that is planned already [s].
LATE_S = 1.0
# So much later than wanted, and so long before its end, what has to end is handed over up to a turn of its
# speed [s].
LATE_CLOSING_S = 0.1
# Where less is left of a line with a time of its own it is not cut: its T is known to some microseconds [s].
LEAST_REST_S = 0.004
# Share of the greatest speed that rounding may leave where the motion rests.
TRACE_OF_SPEED = 1e-6
# Shorter phases are left by rounding [s].
LEAST_PHASE_S = 1e-6


def commit_moment(
    plan: PlannedRun, want: float, *, at_peaks: bool = False, inside_timed: bool = False
) -> float:
    """Return a time with zero acceleration at or after ``want`` [s], before the stop begins; 0
    without one.

    Args:
        at_peaks: a moment at which speed has a peak will do, however near a steady one is. What is left of
            its segment has less room for a corner in a time of its own, should it be planned again.
        inside_timed: a moment inside of a line with a time of its own will do: what is left of it gets the
            rest of its T.
    """
    moment = _moment(plan, want, at_peaks=at_peaks, inside_timed=inside_timed)
    if moment > want + LATE_S and not at_peaks:
        moment = _moment(plan, want, at_peaks=True, inside_timed=inside_timed)
    return moment


def closing_moment(plan: PlannedRun, want: float) -> float:
    """Return up to when a plan that is kept is handed over [s].

    That is a time as of `commit_moment` with peaks. Where it is much later than ``want`` [s], or before that,
    it is a turn of speed: the first one behind ``want``, or else the last one before it.

    What is left of a stretch that is solved as a whole keeps its plan, and an override that comes later finds
    less that is handed over.
    """
    moment = commit_moment(plan, want, at_peaks=True)
    if want <= moment <= want + LATE_CLOSING_S:
        return moment
    if moment > want:
        return min(turn_moment(plan, want, moment), moment)
    until = plan.phases.duration - LATE_CLOSING_S
    turn = turn_moment(plan, want, until)
    if math.isfinite(turn):
        return turn
    while math.isfinite(turn := turn_moment(plan, moment + LATE_CLOSING_S, until)):
        moment = turn
    return moment


def turn_moment(plan: PlannedRun, want: float, until: float) -> float:
    """Return the first time between two [s] at which speed turns from rising to falling or back, also inside
    of what is not cut otherwise; infinite without one.

    A plan that goes on there is smooth; a stretch that is solved as a whole is no longer the quickest one.
    """
    phases = plan.phases
    first, last = phases.span(want, until)
    least = TRACE_OF_SPEED * float(phases.velocity.max())
    for index in range(first, last):
        a, jerk = float(phases.acceleration[index]), float(phases.jerk[index])
        start, end = float(phases.start[index]), phases.end_of(index)
        if plan.timed[index] or jerk == 0.0 or a * (a + jerk * (end - start)) >= 0.0:
            continue
        moment = start - a / jerk
        if want <= moment < until and phases.state(moment)[1] > least:
            segment = plan.segments[plan.segment_at(moment)]
            if segment.duration is None:
                return moment
    return math.inf


def _moment(plan: PlannedRun, want: float, *, at_peaks: bool, inside_timed: bool) -> float:
    safe = _stop_begins(plan)
    if want >= safe:
        return safe
    phases = plan.phases
    trace = 1e-6 * float(np.abs(phases.acceleration).max())
    moment = max(want, 0.0)
    index = int(np.clip(np.searchsorted(phases.start, moment, side="right") - 1, 0, len(phases.start) - 1))
    while index < len(phases.start):
        constant = abs(phases.acceleration[index]) <= trace and phases.jerk[index] == 0.0
        # where two corners in a time of their own meet, no time is left between them, and the plan would
        # go on with the second one's speed
        lasts = phases.end_of(index) - moment > LEAST_PHASE_S
        free = lasts and not plan.timed[index] and not phases.sealed[index]
        if free and constant and phases.velocity[index] > 0.0:
            break
        if free and moment == phases.start[index] and _is_knot(phases, index, trace):
            break
        if at_peaks and free and moment == phases.start[index] and _is_peak(plan, index, trace):
            break
        index += 1
        if index < len(phases.start):
            moment = float(phases.start[index])
    moment = min(moment, safe)
    segment = plan.segment_at(moment)
    ends = float(plan.times[segment + 1])
    if plan.segments[segment].duration is not None and not (
        inside_timed and ends - moment >= LEAST_REST_S and plan.keeps_time(segment)
    ):
        # a line with a time of its own is cut inside only where the rest of its T is what is left of it
        moment = min(ends, safe)
    return moment


def _stop_begins(plan: PlannedRun) -> float:
    """Return the last time with zero acceleration before the stop at the end [s]; 0 where the run is
    one such stop.
    """
    if plan.segments[-1].duration is not None:
        # one profile from its entry to rest: nothing of it is settled before the next line is known
        return float(plan.times[-2])
    phases = plan.phases
    index = len(phases.start)
    if phases.sealed[-1]:
        # the stop is the end of a stretch
        while index > 0 and phases.sealed[index - 1]:
            index -= 1
        return last_steady(plan, float(phases.start[index - 1])) if index > 1 else 0.0
    # rounding leaves traces of acceleration where it should be zero
    trace = 1e-6 * float(np.abs(phases.acceleration).max())
    while index > 0:
        a, j = phases.acceleration[index - 1], phases.jerk[index - 1]
        if phases.sealed[index - 1] or not (a < -trace or (abs(a) <= trace and j < 0.0)):
            break
        index -= 1
    if index == 0 or index == len(phases.start):
        return 0.0
    moment = float(phases.start[index])
    segment = plan.segment_at(moment)
    if plan.segments[segment].duration is not None:
        moment = float(plan.times[segment])
    return moment


def _is_knot(phases: Phases, index: int, trace: float) -> bool:
    """Return whether a phase begins at an end of a stretch that is not to be cut, with speed and no
    acceleration: behind a rest, or what of one a corner in a time of its own has left, it has none or some.
    """
    if abs(phases.acceleration[index]) > trace or not phases.velocity[index] > 0.0:
        return False
    sealed = phases.sealed
    return bool((index > 0 and sealed[index - 1]) or (index + 1 < len(sealed) and sealed[index + 1]))


def _is_peak(plan: PlannedRun, index: int, trace: float) -> bool:
    """Return whether a phase begins with speed and no acceleration, away from corners in a time of their own:
    where two of them meet, the speed between them is that of neither.
    """
    phases = plan.phases
    if index > 0 and plan.timed[index - 1]:
        return False
    return bool(abs(phases.acceleration[index]) <= trace and phases.velocity[index] > 0.0)


def last_steady(plan: PlannedRun, until: float) -> float:
    """The last moment without acceleration that is not later than ``until`` [s]; 0 without one."""
    phases = plan.phases
    trace = 1e-6 * float(np.abs(phases.acceleration).max())
    steady = (np.abs(phases.acceleration) <= trace) & ~plan.timed & (phases.velocity > 0.0)
    steady &= ~phases.sealed & (np.diff(phases.start, append=phases.duration) > LEAST_PHASE_S)
    steady &= phases.start <= until
    if not steady.any():
        return 0.0
    index = int(np.nonzero(steady)[0][-1])
    start = float(phases.start[index])
    if phases.jerk[index] != 0.0:
        return _before_timed(plan, start)
    ends = phases.end_of(index)
    if plan.timed[index + 1 : index + 2].any():
        # a corner in a time of its own begins there, with a speed that is not the path's
        ends = max(ends - LEAST_PHASE_S, start)
    return _before_timed(plan, min(until, ends))


def _before_timed(plan: PlannedRun, moment: float) -> float:
    """Return a time, or where the line begins that it lies in, if that has a time of its own [s].

    Such a line is not cut inside: what is left of it would ask for all of its T.
    """
    segment = plan.segment_at(plan.at_end(moment))
    return float(plan.times[segment]) if plan.segments[segment].duration is not None else moment
