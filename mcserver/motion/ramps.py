"""Profiles over a stretch of path whose limits depend on speed: a ladder of ramps about one Ruckig
profile."""

from __future__ import annotations

import math

from mcserver.motion.limits import Level
from mcserver.motion.profile import (
    NO_DISTANCE,
    Profile,
    ProfileSolver,
    reachable_speed,
    speed_change_distance,
)


def ramp(start: float, end: float, acceleration: float, jerk: float) -> Profile:
    """The quickest change of speed with zero acceleration at both ends, over its own distance."""
    change = abs(end - start)
    sign = 1.0 if end >= start else -1.0
    if math.isinf(jerk):
        times, jerks = [change / acceleration], [0.0]
        first = sign * acceleration
    else:
        peak = min(acceleration, math.sqrt(change * jerk))
        rise = peak / jerk
        times = [rise, max(change / peak - rise, 0.0), rise] if peak > 0.0 else [0.0]
        jerks = [sign * jerk, 0.0, -sign * jerk][: len(times)]
        first = 0.0
    accelerations, velocities, positions = [first], [start], [0.0]
    a, v, p = first, start, 0.0
    for t, j in zip(times, jerks, strict=True):
        p += t * (v + t * (a / 2.0 + t * j / 6.0))
        v += t * (a + t * j / 2.0)
        a += t * j
        accelerations.append(a)
        velocities.append(v)
        positions.append(p)
    positions[-1] = speed_change_distance(min(start, end), max(start, end), acceleration, jerk)
    return Profile(
        duration=sum(times),
        times=times,
        jerks=jerks,
        accelerations=accelerations,
        velocities=velocities,
        positions=positions,
        peak_velocity=max(start, end),
        peak_acceleration=max(abs(x) for x in accelerations),
        plateau=(0.0, 0.0),
    )


def _distance(low: float, high: float, level: Level) -> float:
    return speed_change_distance(low, high, level.acceleration, level.jerk)


def fastest(
    solver: ProfileSolver, distance: float, entry: float, exit_: float, ladder: list[Level]
) -> list[Profile] | None:
    """The quickest profiles that pass ``distance`` from speed ``entry`` to ``exit_`` under a ladder's limits.

    Each rung that is used costs a moment without acceleration, so fewer rungs may be quicker: the whole
    ladder, every other rung and the top rung alone are tried.

    Returns:
        None where the speeds cannot be joined over this distance.
    """
    best: list[Profile] | None = None
    least = math.inf
    for rungs in _choices(ladder):
        trial = _climb(solver, distance, entry, exit_, rungs)
        if trial is not None:
            total = sum(part.duration for part in trial)
            if total < least:
                best, least = trial, total
    if best is not None:
        return best
    # where a change of speed fills the whole distance the solver may miss it by rounding
    for rungs in _choices(ladder):
        trial = _ramps_only(distance, entry, exit_, rungs)
        if trial is not None:
            return trial
    return None


def _ramps_only(distance: float, entry: float, exit_: float, ladder: list[Level]) -> list[Profile] | None:
    """The change of speed by ramps alone, and the greater speed kept over what is left of the distance."""
    low, high = min(entry, exit_), max(entry, exit_)
    rising = entry <= exit_
    speed, left = low, distance
    parts: list[Profile] = []
    for level in ladder:
        if level.velocity <= speed or speed >= high:
            continue
        target = min(level.velocity, high)
        ends = (speed, target) if rising else (target, speed)
        parts.append(ramp(*ends, level.acceleration, level.jerk))
        left -= parts[-1].positions[-1]
        speed = target
    if speed < high or left < 0.0 or high <= 0.0:
        return None
    if left > NO_DISTANCE:
        parts.append(_cruise(left, high))
    return parts if rising else parts[::-1]


def _cruise(distance: float, speed: float) -> Profile:
    time = distance / speed
    return Profile(
        duration=time,
        times=[time],
        jerks=[0.0],
        accelerations=[0.0, 0.0],
        velocities=[speed, speed],
        positions=[0.0, distance],
        peak_velocity=speed,
        peak_acceleration=0.0,
        plateau=(0.0, distance),
    )


def _choices(ladder: list[Level]) -> tuple[list[Level], ...]:
    return (ladder, ladder[1::2], ladder[-1:]) if len(ladder) > 2 else (ladder,)


def reachable(low: float, distance: float, ladder: list[Level], cap: float) -> float:
    """Greatest speed ≤ ``cap`` that `fastest` reaches from ``low`` within ``distance``."""
    return max(_reach(low, distance, rungs, cap) for rungs in _choices(ladder))


def _reach(low: float, distance: float, ladder: list[Level], cap: float) -> float:
    speed, left = low, distance
    for level in ladder:
        if level.velocity <= speed:
            continue
        target = min(level.velocity, cap)
        need = _distance(speed, target, level)
        if need > left:
            return reachable_speed(speed, left, level.acceleration, level.jerk, target)
        speed, left = target, left - need
        if speed >= cap:
            break
    return speed


def _climb(
    solver: ProfileSolver, distance: float, entry: float, exit_: float, ladder: list[Level]
) -> list[Profile] | None:
    """Ramps from rung to rung on both sides as far as the distance allows, and one profile between them."""
    high = max(entry, exit_)
    start = next((i for i, level in enumerate(ladder) if level.velocity >= high * (1.0 - 1e-12)), None)
    if start is None:
        return None
    head: list[Profile] = []
    tail: list[Profile] = []
    up, down, left = entry, exit_, distance
    for index, level in enumerate(ladder):
        if level.velocity <= min(up, down) or index == len(ladder) - 1:
            continue
        need = (_distance(up, level.velocity, level) if up < level.velocity else 0.0) + (
            _distance(down, level.velocity, level) if down < level.velocity else 0.0
        )
        if need > left * (1.0 - 1e-9):
            return _finish(solver, head, tail, left, up, down, ladder[max(index, 0) :], start, index)
        if up < level.velocity:
            head.append(ramp(up, level.velocity, level.acceleration, level.jerk))
            up = level.velocity
        if down < level.velocity:
            tail.append(ramp(level.velocity, down, level.acceleration, level.jerk))
            down = level.velocity
        left -= need
    return _finish(solver, head, tail, left, up, down, ladder[-1:], start, len(ladder) - 1)


def _finish(
    solver: ProfileSolver,
    head: list[Profile],
    tail: list[Profile],
    left: float,
    up: float,
    down: float,
    rest: list[Level],
    start: int,
    index: int,
) -> list[Profile] | None:
    if left <= NO_DISTANCE:
        return head + tail[::-1] if up == down else None
    # the middle may have to pass the rung that the faster end stands on
    level = rest[max(0, start - index)] if start > index else rest[0]
    middle = solver.solve(left, up, down, max(level.velocity, up, down), level.acceleration, level.jerk)
    between = [middle] if middle is not None else _over_a_peak(left, up, down, level)
    return None if between is None else [*head, *between, *tail[::-1]]


def _over_a_peak(distance: float, entry: float, exit_: float, level: Level) -> list[Profile] | None:
    """Up to the greatest speed that the distance allows, along it, and down: in closed form, never
    missing."""

    def need(peak: float) -> float:
        return _distance(entry, peak, level) + _distance(exit_, peak, level)

    low, top = max(entry, exit_), max(level.velocity, entry, exit_)
    if _distance(min(entry, exit_), low, level) > distance * (1.0 + 1e-12):
        return None
    if need(top) > distance:
        for _ in range(100):
            middle = (low + top) / 2.0
            if need(middle) <= distance:
                low = middle
            else:
                top = middle
        top = low
    parts = [ramp(entry, top, level.acceleration, level.jerk)] if top > entry else []
    left = distance - need(top)
    if left > NO_DISTANCE * max(1.0, distance):
        if top <= 0.0:
            return None
        parts.append(_cruise(left, top))
    if top > exit_:
        parts.append(ramp(top, exit_, level.acceleration, level.jerk))
    return parts or None


def exactly(
    solver: ProfileSolver, distance: float, entry: float, exit_: float, ladder: list[Level], duration: float
) -> list[Profile] | None:
    """Profiles that take ``duration`` to the rounding error, or None where the limits do not allow it
    (D-33)."""
    high = max(entry, exit_)
    for level in ladder:
        if level.velocity < high * (1.0 - 1e-12):
            continue
        whole = solver.solve(
            distance, entry, exit_, max(level.velocity, high), level.acceleration, level.jerk, duration
        )
        if whole is not None and abs(whole.duration - duration) <= 1e-9 * max(1.0, duration):
            return [whole]
    quickest = fastest(solver, distance, entry, exit_, ladder)
    if quickest is None or sum(part.duration for part in quickest) > duration:
        return None
    # between: the ladder with a lower top speed takes longer; its duration grows steadily as the top falls
    low, top = high, ladder[-1].velocity
    best = quickest
    for _ in range(60):
        middle = (low + top) / 2.0
        capped = [level for level in ladder if level.velocity < middle]
        above = next((level for level in ladder if level.velocity >= middle), ladder[-1])
        trial = fastest(
            solver, distance, entry, exit_, [*capped, Level(middle, above.acceleration, above.jerk)]
        )
        total = math.inf if trial is None else sum(part.duration for part in trial)
        if trial is not None and total <= duration:
            best, top = trial, middle
        else:
            low = middle
    total = sum(part.duration for part in best)
    return best if abs(total - duration) <= 1e-6 * max(1.0, duration) else None
