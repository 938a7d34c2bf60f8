"""Where a plan is cut to commit its front: moments without acceleration before its stop."""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.profile.velocity_profile import Phases

# Longest that a cut may be after the wanted time, and shortest before the plan's end: a later cut hands over
# rows that a feed override above 100 % can no longer change [s].
LATE_S = 0.06
# A line with a T is not cut with less of it left: T is known to some microseconds only [s].
LEAST_REST_S = 0.004
# Acceleration or speed that rounding may leave where there should be none, as a share of the greatest one.
TRACE = 1e-6
# Shorter phases are artefacts of rounding [s].
LEAST_PHASE_S = 1e-6


def commit_moment(plan: PlannedRun, want: float) -> float:
    """Return a time without acceleration at or after ``want`` and before the stop begins [s]; 0 without one.

    A plan that starts there with more segments is no slower. So the time is not inside a stretch that was
    solved as a whole, a line with a T, or a time-domain blend, whose rest would be slower than the whole.
    """
    return _moment(plan, want, at_peaks=False)


def hand_over_moment(plan: PlannedRun, want: float, *, closing: bool = False) -> float:
    """Return the time up to which a plan is handed over, near ``want`` [s]; 0: only its stop is left.

    Preferably a time as in `commit_moment`. Where that is later than ``want + LATE_S``, a peak of speed, also
    inside a line with a T (whose rest then gets the rest of T) and, if ``closing``, inside a stretch that was
    solved as a whole. Else the last of these before ``want``.

    Args:
        closing: no more lines come. Otherwise such a stretch is not cut: its rest, together with the lines to
            come, would often have no plan, and the motion would end on its stop.
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
    """Return the first time in a range at which acceleration changes its sign [s]; infinite without one.

    It may be inside a stretch that was solved as a whole: a plan cut there stays smooth, but that stretch is
    no longer the fastest one.
    """
    phases = plan.phases
    first, last = phases.span(want, until)
    least = _trace(phases.velocity)
    for index in range(first, last):
        a, jerk = float(phases.acceleration[index]), float(phases.jerk[index])
        start, end = float(phases.start[index]), phases.end_of(index)
        if plan.timed[index] or jerk == 0.0 or a * (a + jerk * (end - start)) >= 0.0:
            continue
        moment = start - a / jerk
        # within rounding of a phase's end a time-domain blend may begin, with another speed
        inside = end - moment > LEAST_PHASE_S and want <= moment < until and phases.state(moment)[1] > least
        if inside and not plan.held[plan.segment_at(moment)]:
            return moment
    return math.inf


def _moment(plan: PlannedRun, want: float, *, at_peaks: bool, inside_timed: bool = False) -> float:
    safe = _stop_begins(plan, inside_timed=inside_timed)
    if want >= safe:
        return _outside_timed(plan, safe, safe, inside_timed=inside_timed)
    phases = plan.phases
    trace = _trace(phases.acceleration)
    moment = max(want, 0.0)
    index = int(np.clip(np.searchsorted(phases.start, moment, side="right") - 1, 0, len(phases.start) - 1))
    while index < len(phases.start):
        constant = abs(phases.acceleration[index]) <= trace and phases.jerk[index] == 0.0
        # between two time-domain blends that meet no time is left: a plan cut there would start with the
        # second one's speed
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
    """Return a time [s], moved to an end of its line if that has a T.

    The end of the line if that is no later than ``safe``, else its beginning. With ``inside_timed`` a line
    that keeps its T exactly is cut inside: its rest then has the rest of T.
    """
    segment = plan.segment_at(moment)
    begins, ends = float(plan.times[segment]), float(plan.times[segment + 1])
    if not plan.held[segment] or moment == begins:
        return moment
    if inside_timed and ends - moment >= LEAST_REST_S and plan.keeps_time(segment):
        return moment
    return ends if ends <= safe else begins


def _stop_begins(plan: PlannedRun, *, inside_timed: bool) -> float:
    """Return the last time without acceleration before the stop at the end [s]; 0: the run is one stop."""
    if plan.held[-1] and not inside_timed:
        # one profile from the line's entry to rest, all of which the next line may change
        return float(plan.times[-2])
    phases = plan.phases
    index = len(phases.start)
    if phases.uncut[-1]:
        # the stop is the end of a stretch
        while index > 0 and phases.uncut[index - 1]:
            index -= 1
        return last_steady(plan, float(phases.start[index - 1])) if index > 1 else 0.0
    trace = _trace(phases.acceleration)
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


def _trace(values: Array) -> float:
    """Return what rounding may leave where a plan's acceleration or speed should be zero."""
    return TRACE * float(np.abs(values).max())


def _is_knot(phases: Phases, index: int, trace: float) -> bool:
    """Return whether a phase begins at an end of an uncut stretch, with speed and without acceleration.

    An end at a rest has no speed; one that a time-domain blend has trimmed has acceleration.
    """
    if abs(phases.acceleration[index]) > trace or not phases.velocity[index] > 0.0:
        return False
    uncut = phases.uncut
    return bool((index > 0 and uncut[index - 1]) or (index + 1 < len(uncut) and uncut[index + 1]))


def _is_peak(plan: PlannedRun, index: int, trace: float) -> bool:
    """Return whether a phase begins with speed and without acceleration, not at the end of a blend.

    Where two time-domain blends meet, the speed between them is that of neither.
    """
    phases = plan.phases
    if index > 0 and plan.timed[index - 1]:
        return False
    return bool(abs(phases.acceleration[index]) <= trace and phases.velocity[index] > 0.0)


def last_steady(plan: PlannedRun, until: float) -> float:
    """Return the last time without acceleration at or before ``until`` [s]; 0 without one."""
    phases = plan.phases
    trace = _trace(phases.acceleration)
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
    """Return a time, or the beginning of the line that it lies in, if that has a T [s]."""
    segment = plan.segment_at(plan.at_end(moment))
    return float(plan.times[segment]) if plan.held[segment] else moment
