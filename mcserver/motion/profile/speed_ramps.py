"""Profiles over a stretch of path whose limits depend on speed: ramps by an acceleration-limit table
about one peak.
"""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.phases import PHASE, PHASES_PER_MOVE, moves_to_phases
from mcserver.motion.kernels.ramp_kernels import MAX_MOVES, MOVE, min_time_moves, ramp_distance
from mcserver.motion.lookahead.path_limits import AccelerationLimit
from mcserver.motion.profile.velocity_profile import Profile, ProfileSolver


def ramp(start: float, end: float, acceleration: float, jerk: float) -> Profile:
    """Return the minimum-time change of speed with zero acceleration at both ends, over its own distance."""
    length = ramp_distance(min(start, end), max(start, end), acceleration, jerk)
    return _profile_of(np.array([[start, end, acceleration, jerk, length]]))


def _profile_of(move: Array) -> Profile:
    """Return one move, shape (1, `MOVE`), as a profile."""
    rows = np.empty((PHASES_PER_MOVE, PHASE))
    count = moves_to_phases(move, 1, rows, 0, 0.0)
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


def min_time_profiles(
    distance: float, entry: float, exit_: float, limit_table: list[AccelerationLimit]
) -> list[Profile] | None:
    """Return the minimum-time profiles over ``distance`` from speed ``entry`` to ``exit_`` under a limit
    table.

    Returns:
        None where the speeds cannot be joined over this distance.
    """
    moves, spare = np.empty((MAX_MOVES, MOVE)), np.empty((MAX_MOVES, MOVE))
    limit_rows = np.array([(row.velocity, row.acceleration, row.jerk) for row in limit_table])
    count = min_time_moves(moves, spare, distance, entry, exit_, limit_rows, len(limit_rows))
    return [_profile_of(moves[index : index + 1]) for index in range(count)] or None


def profiles_in_time(
    solver: ProfileSolver,
    distance: float,
    entry: float,
    exit_: float,
    limit_table: list[AccelerationLimit],
    duration: float,
) -> list[Profile] | None:
    """Return profiles that take ``duration`` to the rounding error, or None where the limits do not allow
    it (D-33).
    """
    high = max(entry, exit_)
    for row in limit_table:
        if row.velocity < high * (1.0 - 1e-12):
            continue
        whole = solver.solve(
            distance, entry, exit_, max(row.velocity, high), row.acceleration, row.jerk, duration
        )
        if whole is not None and abs(whole.duration - duration) <= 1e-9 * max(1.0, duration):
            return [whole]
    quickest = min_time_profiles(distance, entry, exit_, limit_table)
    if quickest is None or sum(part.duration for part in quickest) > duration:
        return None
    # between: the limit table with a lower top speed takes longer; its duration grows steadily as the top
    # falls
    low, top = high, limit_table[-1].velocity
    best = quickest
    for _ in range(60):
        middle = (low + top) / 2.0
        capped = [row for row in limit_table if row.velocity < middle]
        above = next((row for row in limit_table if row.velocity >= middle), limit_table[-1])
        trial = min_time_profiles(
            distance, entry, exit_, [*capped, AccelerationLimit(middle, above.acceleration, above.jerk)]
        )
        total = math.inf if trial is None else sum(part.duration for part in trial)
        if trial is not None and total <= duration:
            best, top = trial, middle
        else:
            low = middle
    total = sum(part.duration for part in best)
    return best if abs(total - duration) <= 1e-6 * max(1.0, duration) else None
