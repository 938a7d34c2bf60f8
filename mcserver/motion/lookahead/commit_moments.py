"""Where a plan is cut: moments without acceleration before its stop, from which it can be planned anew."""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.profile.velocity_profile import Phases

# So much later than wanted, and so long before its end, motion is handed over up to a peak or a turn of its
# speed: a feed override above 100 % finds less that is handed over already [s].
LATE_S = 0.06
# Where less is left of a line with a time of its own it is not cut: its T is known to some microseconds [s].
LEAST_REST_S = 0.004
# Share of the greatest speed that rounding may leave where the motion rests.
TRACE_OF_SPEED = 1e-6
# Shorter phases are left by rounding [s].
LEAST_PHASE_S = 1e-6


def commit_moment(plan: PlannedRun, want: float) -> float:
    """Return a time with zero acceleration at or after ``want`` [s], before the stop begins; 0 without one.

    From there a plan goes on as well with other segments behind: what is left of a stretch that is solved as
    a whole, of a line with a T, or before a time-domain blend would be slower than the whole.
    """
    return _moment(plan, want, at_peaks=False)


def hand_over_moment(plan: PlannedRun, want: float, *, closing: bool = False) -> float:
    """Return up to when a plan is handed over, a little after ``want`` [s]; 0: only its stop is left.

    That is a time as of `commit_moment`; where it would be much later, one at which speed has a peak, turns
    inside of a stretch that is solved as a whole, or inside of a line with a T of its own, whose rest gets
    the rest of its T. Else the last of these before ``want``.

    Args:
        closing: no more lines come. Else a curve that is solved as a whole is not cut inside: with the lines
            to come the rest of it would often have no plan, and motion would end on its stop.
    """
    moment = _moment(plan, want, at_peaks=False)
    if want <= moment <= want + LATE_S:
        return moment
    for inside_timed in (False, True):
        other = _moment(plan, want, at_peaks=True, inside_timed=inside_timed)
        if want <= other <= want + LATE_S:
            return other
        moment = min(moment, other) if other >= want else max(moment, other)
    if not closing:
        return moment
    if moment > want:
        return min(turn_moment(plan, want, moment), moment)
    until = plan.phases.duration - LATE_S
    turn = turn_moment(plan, want, until)
    if math.isfinite(turn):
        return turn
    while math.isfinite(turn := turn_moment(plan, moment + LATE_S, until)):
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
        # at a phase's end but for rounding a time-domain blend may stand, with another speed
        inside = end - moment > LEAST_PHASE_S and want <= moment < until and phases.state(moment)[1] > least
        if inside and not plan.held[plan.segment_at(moment)]:
            return moment
    return math.inf


def _moment(plan: PlannedRun, want: float, *, at_peaks: bool, inside_timed: bool = False) -> float:
    safe = _stop_begins(plan, inside_timed=inside_timed)
    if want >= safe:
        return _outside_timed(plan, safe, safe, inside_timed=inside_timed)
    phases = plan.phases
    trace = 1e-6 * float(np.abs(phases.acceleration).max())
    moment = max(want, 0.0)
    index = int(np.clip(np.searchsorted(phases.start, moment, side="right") - 1, 0, len(phases.start) - 1))
    while index < len(phases.start):
        constant = abs(phases.acceleration[index]) <= trace and phases.jerk[index] == 0.0
        # where two time-domain blends meet, no time is left between them, and the plan would
        # go on with the second one's speed
        lasts = phases.end_of(index) - moment > LEAST_PHASE_S
        free = lasts and not plan.timed[index] and not phases.uncut[index]
        if free and constant and phases.velocity[index] > 0.0:
            break
        if free and moment == phases.start[index] and _is_knot(phases, index, trace):
            break
        if at_peaks and free and moment == phases.start[index] and _is_peak(plan, index, trace):
            break
        index += 1
        if index < len(phases.start):
            moment = float(phases.start[index])
    return _outside_timed(plan, min(moment, safe), safe, inside_timed=inside_timed)


def _outside_timed(plan: PlannedRun, moment: float, safe: float, *, inside_timed: bool) -> float:
    """Return a time, or an end of the line that it lies in, if that has a T of its own, up to ``safe`` [s].

    Such a line is cut inside only where the rest of its T is what is left of it.
    """
    segment = plan.segment_at(moment)
    begins, ends = float(plan.times[segment]), float(plan.times[segment + 1])
    if not plan.held[segment] or moment == begins:
        return moment
    if inside_timed and ends - moment >= LEAST_REST_S and plan.keeps_time(segment):
        return moment
    return ends if ends <= safe else begins


def _stop_begins(plan: PlannedRun, *, inside_timed: bool) -> float:
    """Return the last time with zero acceleration before the stop at the end [s]; 0 where the run is
    one such stop.
    """
    if plan.held[-1] and not inside_timed:
        # one profile from its entry to rest: nothing of it is settled before the next line is known
        return float(plan.times[-2])
    phases = plan.phases
    index = len(phases.start)
    if phases.uncut[-1]:
        # the stop is the end of a stretch
        while index > 0 and phases.uncut[index - 1]:
            index -= 1
        return last_steady(plan, float(phases.start[index - 1])) if index > 1 else 0.0
    # rounding leaves traces of acceleration where it should be zero
    trace = 1e-6 * float(np.abs(phases.acceleration).max())
    while index > 0:
        a, j = phases.acceleration[index - 1], phases.jerk[index - 1]
        if phases.uncut[index - 1] or not (a < -trace or (abs(a) <= trace and j < 0.0)):
            break
        index -= 1
    if index == 0 or index == len(phases.start):
        return 0.0
    moment = float(phases.start[index])
    if plan.timed[index]:
        # a time-domain blend begins the stop, with a speed that is not the path's
        moment = max(moment - LEAST_PHASE_S, 0.0)
    return _outside_timed(plan, moment, moment, inside_timed=inside_timed)


def _is_knot(phases: Phases, index: int, trace: float) -> bool:
    """Return whether a phase begins at an end of a stretch that is not to be cut, with speed and no
    acceleration: behind a rest, or what a time-domain blend has left of one, it has none or some.
    """
    if abs(phases.acceleration[index]) > trace or not phases.velocity[index] > 0.0:
        return False
    uncut = phases.uncut
    return bool((index > 0 and uncut[index - 1]) or (index + 1 < len(uncut) and uncut[index + 1]))


def _is_peak(plan: PlannedRun, index: int, trace: float) -> bool:
    """Return whether a phase begins with speed and no acceleration, away from time-domain blends:
    where two of them meet, the speed between them is that of neither.
    """
    phases = plan.phases
    if index > 0 and plan.timed[index - 1]:
        return False
    return bool(abs(phases.acceleration[index]) <= trace and phases.velocity[index] > 0.0)


def last_steady(plan: PlannedRun, until: float) -> float:
    """Return the last moment without acceleration that is not later than ``until`` [s]; 0 without one."""
    phases = plan.phases
    trace = 1e-6 * float(np.abs(phases.acceleration).max())
    steady = (np.abs(phases.acceleration) <= trace) & ~plan.timed & (phases.velocity > 0.0)
    steady &= ~phases.uncut & (np.diff(phases.start, append=phases.duration) > LEAST_PHASE_S)
    steady &= phases.start <= until
    if not steady.any():
        return 0.0
    index = int(np.nonzero(steady)[0][-1])
    start = float(phases.start[index])
    if phases.jerk[index] != 0.0:
        return _before_timed(plan, start)
    ends = phases.end_of(index)
    if plan.timed[index + 1 : index + 2].any():
        # a time-domain blend begins there, with a speed that is not the path's
        ends = max(ends - LEAST_PHASE_S, start)
    return _before_timed(plan, min(until, ends))


def _before_timed(plan: PlannedRun, moment: float) -> float:
    """Return a time, or where the line begins that it lies in, if that has a T of its own [s].

    Such a line is not cut inside: what is left of it would ask for all of its T.
    """
    segment = plan.segment_at(plan.at_end(moment))
    return float(plan.times[segment]) if plan.held[segment] else moment
