"""Profiles over a stretch of path whose limits depend on speed: a ladder of ramps about one peak."""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.phases import PHASE, PHASES_A_MOVE, expand
from mcserver.motion.kernels.ramp_kernels import MOST_MOVES, MOVE, change_distance, fastest_moves
from mcserver.motion.lookahead.path_limits import Level
from mcserver.motion.profile.velocity_profile import Profile, ProfileSolver


def ramp(start: float, end: float, acceleration: float, jerk: float) -> Profile:
    """The quickest change of speed with zero acceleration at both ends, over its own distance."""
    length = change_distance(min(start, end), max(start, end), acceleration, jerk)
    return _profile_of(np.array([[start, end, acceleration, jerk, length]]))


def _profile_of(move: Array) -> Profile:
    """One move, shape (1, `MOVE`), as a profile."""
    rows = np.empty((PHASES_A_MOVE, PHASE))
    count = expand(move, 1, rows, 0, 0.0)
    times, positions, velocities, accelerations, jerks = rows[:count].T.tolist()
    start, end, _, _, length = move[0].tolist()
    last = accelerations[-1] + times[-1] * jerks[-1]
    return Profile(
        duration=sum(times),
        times=times,
        jerks=jerks,
        accelerations=[*accelerations, last],
        velocities=[*velocities, end],
        positions=[*positions, length],
        peak_velocity=max(start, end),
        peak_acceleration=max(abs(x) for x in accelerations),
    )


def fastest(distance: float, entry: float, exit_: float, ladder: list[Level]) -> list[Profile] | None:
    """The quickest profiles that pass ``distance`` from speed ``entry`` to ``exit_`` under a ladder's limits.

    Returns:
        None where the speeds cannot be joined over this distance.
    """
    moves, spare = np.empty((MOST_MOVES, MOVE)), np.empty((MOST_MOVES, MOVE))
    rungs = np.array([(level.velocity, level.acceleration, level.jerk) for level in ladder])
    count = fastest_moves(moves, spare, distance, entry, exit_, rungs, len(rungs))
    return [_profile_of(moves[index : index + 1]) for index in range(count)] or None


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
    quickest = fastest(distance, entry, exit_, ladder)
    if quickest is None or sum(part.duration for part in quickest) > duration:
        return None
    # between: the ladder with a lower top speed takes longer; its duration grows steadily as the top falls
    low, top = high, ladder[-1].velocity
    best = quickest
    for _ in range(60):
        middle = (low + top) / 2.0
        capped = [level for level in ladder if level.velocity < middle]
        above = next((level for level in ladder if level.velocity >= middle), ladder[-1])
        trial = fastest(distance, entry, exit_, [*capped, Level(middle, above.acceleration, above.jerk)])
        total = math.inf if trial is None else sum(part.duration for part in trial)
        if trial is not None and total <= duration:
            best, top = trial, middle
        else:
            low = middle
    total = sum(part.duration for part in best)
    return best if abs(total - duration) <= 1e-6 * max(1.0, duration) else None
