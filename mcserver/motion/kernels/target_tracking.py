"""One cycle of axes that follow streamed targets: the next setpoints, within all limits for any targets.

Each axis has a state (position, velocity, acceleration) and in every cycle one motion that is always
possible: its fastest stop. A jerk is applied for a cycle only if after it that stop stays within velocity,
acceleration and travel; where no jerk qualifies, the cycle is one of the stop itself. So no sequence of
targets leads to a state from which a limit has to be broken (an invariant set with a backup control: by
induction over cycles).

Among the allowed jerks, the wanted one is that after which the fastest change to the reference's velocity
would end on the reference: time-optimal far away, exact once there.
"""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Columns of a state, and of the limits of an axis.
POSITION, VELOCITY, ACCELERATION = range(3)
MAX_VELOCITY, MAX_ACCELERATION, MAX_JERK, LOWEST, HIGHEST = range(5)
# Iterations for the jerk that meets the reference.
MEETING_TRIES = 16
# Iterations for the nearest allowed jerk.
ALLOWED_TRIES = 20
# Share of the jerk limit with which an axis is planned to meet its reference: the rest is for the
# acceleration of the reference itself.
MEETING_JERK = 0.8
# Least share of the acceleration limit for planning, however much the reference itself accelerates.
MEETING_ACCELERATION = 0.2
# Tolerance of meeting the reference, as a share of the displacement by a cycle of full jerk.
NO_MISS = 1e-4
# Tolerance of being on the reference, as a share of the same: rounding, and numbers too small to compute
# with.
SAME = 1e-6


@compiled
def _peak_deceleration(velocity: float, acceleration: float, most: float, jerk: float) -> float:
    """Return the peak deceleration of the fastest stop from a state with `_heading` forwards [m/s²]."""
    return min(most, math.sqrt(max(jerk * velocity + 0.5 * acceleration * acceleration, 0.0)))


@compiled
def _heading(velocity: float, acceleration: float, jerk: float) -> float:
    """Return the direction of motion in which the fastest stop brakes.

    That is the sign of the velocity once acceleration has come to 0.
    """
    left = velocity + 0.5 * acceleration * abs(acceleration) / jerk
    return 1.0 if left >= 0.0 else -1.0


@compiled
def _stop_distance(velocity: float, acceleration: float, most: float, jerk: float) -> float:
    """Return the displacement of the fastest stop [m or rad]."""
    way = _heading(velocity, acceleration, jerk)
    v, a = way * velocity, way * acceleration
    peak = _peak_deceleration(v, a, most, jerk)
    t = max((a + peak) / jerk, 0.0)
    x = t * (v + t * (0.5 * a - t * jerk / 6.0))
    v += t * (a - 0.5 * t * jerk)
    # above the last ramp of jerk, velocity falls at the peak deceleration
    end = 0.5 * peak * peak / jerk
    if peak > 0.0 and v > end:
        t = (v - end) / peak
        x += 0.5 * t * (v + end)
    return way * (x + peak * peak * peak / (6.0 * jerk * jerk))


@compiled
def _turn(velocity: float, acceleration: float, jerk: float) -> float:
    """Return the displacement at which the fastest stop reverses; 0 where it does not [m or rad]."""
    way = _heading(velocity, acceleration, jerk)
    v, a = way * velocity, way * acceleration
    if v >= 0.0:
        return 0.0
    # backwards at first, with an acceleration that reverses the motion
    t = (a - math.sqrt(max(a * a + 2.0 * jerk * v, 0.0))) / jerk
    return way * t * (v + t * (0.5 * a - t * jerk / 6.0))


@compiled
def _step(state: Array, jerk: float, t: float) -> None:
    """Advance a state by a time at constant jerk."""
    p, v, a = state[POSITION], state[VELOCITY], state[ACCELERATION]
    state[POSITION] = p + t * (v + t * (0.5 * a + t * jerk / 6.0))
    state[VELOCITY] = v + t * (a + 0.5 * t * jerk)
    state[ACCELERATION] = a + t * jerk


@compiled
def _stop_step(state: Array, most: float, jerk: float, cycle_s: float) -> None:
    """Advance a state by one cycle of its fastest stop."""
    way = _heading(state[VELOCITY], state[ACCELERATION], jerk)
    v, a = way * state[VELOCITY], way * state[ACCELERATION]
    peak = _peak_deceleration(v, a, most, jerk)
    left = cycle_s
    ramp = max((a + peak) / jerk, 0.0)
    t = min(left, ramp)
    _step(state, -way * jerk, t)
    left -= t
    if left <= 0.0:
        return
    v, end = way * state[VELOCITY], 0.5 * peak * peak / jerk
    if peak > 0.0 and v > end:
        t = min(left, (v - end) / peak)
        state[ACCELERATION] = -way * peak
        _step(state, 0.0, t)
        left -= t
        if left <= 0.0:
            return
    t = min(left, -way * state[ACCELERATION] / jerk)
    if t > 0.0:
        _step(state, way * jerk, t)
    if left > t:
        # at rest within the cycle
        state[VELOCITY] = 0.0
        state[ACCELERATION] = 0.0


@compiled
def _excess(state: Array, limit: Array, top: float, jerk: float) -> int:
    """Return 1 where the fastest stop from a state exceeds an upper limit, -1 a lower one; else 0."""
    v, a = state[VELOCITY], state[ACCELERATION]
    left = v + 0.5 * a * abs(a) / jerk
    if max(v, left) > top or a > limit[MAX_ACCELERATION]:
        return 1
    if min(v, left) < -top or a < -limit[MAX_ACCELERATION]:
        return -1
    rest = _stop_distance(v, a, limit[MAX_ACCELERATION], jerk)
    turn = _turn(v, a, jerk)
    if state[POSITION] + max(rest, turn, 0.0) > limit[HIGHEST]:
        return 1
    if state[POSITION] + min(rest, turn, 0.0) < limit[LOWEST]:
        return -1
    return 0


@compiled
def _miss(state: Array, target: Array, most: float, jerk: float, by_velocity: bool) -> float:
    """Return how far beyond a reference the fastest change to its velocity ends [m or rad].

    With ``by_velocity`` how much faster the axis is once its acceleration is the reference's [m/s or rad/s].
    """
    w, a = state[VELOCITY] - target[VELOCITY], state[ACCELERATION] - target[ACCELERATION]
    if by_velocity:
        return float(w + 0.5 * a * abs(a) / jerk)
    return float(state[POSITION] - target[POSITION] + _stop_distance(w, a, most, jerk))


@compiled
def _landing_jerk(state: Array, target: Array, most: float, cycle_s: float, by_velocity: bool) -> float:
    """Return the first of three jerks (two, by velocity) that bring an axis exactly onto its reference.

    Each lasts a cycle; NaN where one of them exceeds ``most``.
    """
    t = cycle_s
    e, w = state[POSITION] - target[POSITION], state[VELOCITY] - target[VELOCITY]
    a = state[ACCELERATION] - target[ACCELERATION]
    # the reference is that at the end of this cycle
    e, w = e + t * (target[VELOCITY] - 0.5 * t * target[ACCELERATION]), w + t * target[ACCELERATION]
    if by_velocity:
        first = -(w + 1.5 * t * a) / (t * t)
        second, third = -a / t - first, 0.0
    else:
        first = -(e + 2.0 * t * w + (11.0 / 6.0) * t * t * a) / (t * t * t)
        second = -(w + 2.5 * t * a) / (t * t) - 2.0 * first
        third = -a / t - first - second
    return first if max(abs(first), abs(second), abs(third)) <= most else math.nan


@compiled
def _wanted_jerk(
    state: Array, target: Array, limit: Array, jerk: float, cycle_s: float, by_velocity: bool, after: Array
) -> float:
    """Return the jerk of this cycle after which an axis would meet its reference."""
    most = limit[MAX_ACCELERATION]
    landing = _landing_jerk(state, target, jerk, cycle_s, by_velocity)
    if not math.isnan(landing):
        return landing
    meeting = max(most - abs(target[ACCELERATION]), MEETING_ACCELERATION * most)
    planned = MEETING_JERK * jerk
    low = max(-jerk, (-most - state[ACCELERATION]) / cycle_s)
    high = min(jerk, (most - state[ACCELERATION]) / cycle_s)
    after[:] = state
    _step(after, low, cycle_s)
    above = _miss(after, target, meeting, planned, by_velocity)
    if above >= 0.0:
        return float(low)
    after[:] = state
    _step(after, high, cycle_s)
    below = _miss(after, target, meeting, planned, by_velocity)
    if below <= 0.0:
        return float(high)
    # false position with reduced weight of a retained end (Illinois method): the miss grows with the jerk
    below, above = above, below
    enough = NO_MISS * jerk * cycle_s * cycle_s * (1.0 if by_velocity else cycle_s)
    tried, kept = 0.0, 0
    for _ in range(MEETING_TRIES):
        tried = (low * above - high * below) / (above - below)
        after[:] = state
        _step(after, tried, cycle_s)
        miss = _miss(after, target, meeting, planned, by_velocity)
        if abs(miss) <= enough:
            break
        if miss > 0.0:
            high, above = tried, miss
            below *= 0.5 if kept > 0 else 1.0
            kept = 1
        else:
            low, below = tried, miss
            above *= 0.5 if kept < 0 else 1.0
            kept = -1
    return tried


@compiled
def _allowed_jerk(
    state: Array, wanted: float, limit: Array, top: float, jerk: float, cycle_s: float, after: Array
) -> bool:
    """Set ``after`` to the state after the allowed jerk nearest to the wanted one; False: none is allowed."""
    low, high, tried = -jerk, jerk, wanted
    best = math.nan
    for _ in range(ALLOWED_TRIES):
        after[:] = state
        _step(after, tried, cycle_s)
        excess = _excess(after, limit, top, jerk)
        # within the cycle speed may be greater than at both ends
        mean = (after[POSITION] - state[POSITION]) / cycle_s
        if excess == 0 and abs(mean) > top:
            excess = 1 if mean > 0.0 else -1
        if excess == 0:
            best = tried
            if tried == wanted:
                return True
        if excess > 0 or (excess == 0 and tried > wanted):
            high = tried
        else:
            low = tried
        tried = 0.5 * (low + high)
    if math.isnan(best):
        return False
    after[:] = state
    _step(after, best, cycle_s)
    return True


@compiled
def _same(state: Array, target: Array, jerk: float, cycle_s: float) -> bool:
    """Return whether an axis is on its reference, within the displacement of `SAME` of its jerk."""
    near = SAME * jerk * cycle_s
    if abs(state[ACCELERATION] - target[ACCELERATION]) > near:
        return False
    near *= cycle_s
    if abs(state[VELOCITY] - target[VELOCITY]) > near:
        return False
    return bool(abs(state[POSITION] - target[POSITION]) <= near * cycle_s)


@compiled
def read_reference(knots: Array, time: float, by_velocity: bool, found: Array) -> None:
    """Read position, velocity and acceleration of all references at a time.

    Args:
        knots: shape (m, 1 + 2 n), m > 0: time [s], positions and velocities of the n axes; cubic between
            knots, constant velocity after the last one.
        by_velocity: only velocities are followed, linear between knots.
        found: shape (n, 3), set.
    """
    axes, count = len(found), len(knots)
    at = 0
    while at < count and knots[at, 0] <= time:
        at += 1
    if at == 0 or at == count:
        at = min(max(at - 1, 0), count - 1)
        passed = max(time - knots[at, 0], 0.0)
        for axis in range(axes):
            found[axis, VELOCITY] = knots[at, 1 + axes + axis]
            found[axis, POSITION] = knots[at, 1 + axis] + passed * found[axis, VELOCITY]
            found[axis, ACCELERATION] = 0.0
        return
    long = knots[at, 0] - knots[at - 1, 0]
    t = time - knots[at - 1, 0]
    for axis in range(axes):
        p, v = knots[at - 1, 1 + axis], knots[at - 1, 1 + axes + axis]
        w = knots[at, 1 + axes + axis]
        mean = 0.5 * (v + w) if by_velocity else (knots[at, 1 + axis] - p) / long
        c = (3.0 * mean - 2.0 * v - w) / long
        d = (v + w - 2.0 * mean) / (long * long)
        found[axis, POSITION] = p + t * (v + t * (c + t * d))
        found[axis, VELOCITY] = v + t * (2.0 * c + 3.0 * t * d)
        found[axis, ACCELERATION] = 2.0 * c + 6.0 * t * d


@compiled
def follow_targets(
    states: Array, targets: Array, limits: Array, share: float, cycle_s: float, by_velocity: bool
) -> None:
    """Advance axes that follow references by one cycle.

    Args:
        states: shape (n, 3), position, velocity and acceleration, set to those after the cycle.
        targets: shape (n, 3), the references after the cycle; may hold any numbers, and are bounded in place
            to what can be followed.
        limits: shape (n, 5): velocity, acceleration, jerk (inf: not limited), lowest and highest position.
        share: of the velocities, 0 to 1; 0: to a stop.
        by_velocity: only velocities are followed.
    """
    after = np.empty(3)
    for axis in range(len(states)):
        state, target, limit = states[axis], targets[axis], limits[axis]
        most = limit[MAX_ACCELERATION]
        # without a limit: from one limit of acceleration to the other within a cycle
        jerk = min(limit[MAX_JERK], 2.0 * most / cycle_s)
        top = share * limit[MAX_VELOCITY]
        known = math.isfinite(target[POSITION]) or by_velocity
        if not (known and math.isfinite(target[VELOCITY]) and math.isfinite(target[ACCELERATION])):
            top = 0.0
        if top <= 0.0:
            _stop_step(state, most, jerk, cycle_s)
            continue
        if abs(target[VELOCITY]) > top:
            target[VELOCITY] = min(max(target[VELOCITY], -top), top)
            target[ACCELERATION] = 0.0
        target[ACCELERATION] = min(max(target[ACCELERATION], -most), most)
        if not limit[LOWEST] <= target[POSITION] <= limit[HIGHEST] and not by_velocity:
            target[POSITION] = min(max(target[POSITION], limit[LOWEST]), limit[HIGHEST])
            target[VELOCITY] = 0.0
            target[ACCELERATION] = 0.0
        wanted = _wanted_jerk(state, target, limit, jerk, cycle_s, by_velocity, after)
        if _allowed_jerk(state, wanted, limit, top, jerk, cycle_s, after):
            on = not by_velocity and _same(after, target, jerk, cycle_s)
            state[:] = target if on and _excess(target, limit, top, jerk) == 0 else after
        else:
            _stop_step(state, most, jerk, cycle_s)


@compiled
def follow_reference(
    states: Array,
    reference: Array,
    knots: Array,
    limits: Array,
    share: float,
    times: Array,
    cycle_s: float,
    by_velocity: bool,
) -> None:
    """Advance axes that follow a reference along its knots by several cycles.

    Args:
        states, limits, share, cycle_s, by_velocity: as in `follow_targets`.
        reference: shape (n, 3), set to that after the last cycle.
        knots: as in `read_reference`; without any the reference stays where it is.
        times: at the end of each cycle, shape (m,) [s].
    """
    for time in times:
        if len(knots):
            read_reference(knots, time, by_velocity, reference)
        follow_targets(states, reference, limits, share, cycle_s, by_velocity)
        if by_velocity:
            # positions that are streamed later begin where the axes are
            reference[:, POSITION] = states[:, POSITION]
