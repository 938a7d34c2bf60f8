"""Velocity profiles on one path coordinate: jerk-limited, between two speeds at which acceleration is zero.

The profiles are Ruckig's, one degree of freedom. They come out as phases of constant jerk, so that a whole
motion is sampled with numpy in one go and its duration is exact, not rounded to the cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import ruckig
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.phases import PHASE, times_at_positions
from mcserver.motion.kernels.ramp_kernels import NO_DISTANCE

# Longest profile that is given to Ruckig as it is [s].
LONGEST_S = 1000.0
# Acceleration that a profile of a given duration is solved with, beside the mean speed over that duration.
PLENTY = 1e4
# Shares of the limits that are tried one after the other.
NUDGES = (1.0, 1.0 - 1e-10, 1.0 - 1e-8)


@dataclass(frozen=True)
class Phases:
    """Consecutive phases of constant jerk.

    Attributes:
        start: times at which the phases begin, shape (n,) [s], increasing.
        duration: total duration [s].
        position, velocity, acceleration, jerk: at the beginning of each phase, shape (n,).
        end: position at the end of the last phase; beyond it the coordinate stays there.
        sealed: phases at whose start, and inside of which, the profile is not cut, shape (n,).
    """

    start: Array
    duration: float
    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    end: float
    sealed: NDArray[np.bool_]

    @cached_property
    def rows(self) -> Array:
        """The phases as rows of `mcserver.motion.kernels.phases`."""
        lasts = np.diff(self.start, append=self.duration)
        return np.column_stack((lasts, self.position, self.velocity, self.acceleration, self.jerk))

    def end_of(self, index: int) -> float:
        """Return when a phase ends [s]."""
        return float(self.start[index + 1]) if index + 1 < len(self.start) else self.duration

    def span(self, low: float, high: float) -> tuple[int, int]:
        """Return the first phase under way between two times [s], and the one after the last."""
        first = int(np.clip(np.searchsorted(self.start, low, side="right") - 1, 0, len(self.start) - 1))
        return first, max(int(np.searchsorted(self.start, high, side="left")), first + 1)

    def between(self, low: float, high: float) -> Array:
        """Return the part between two times [s] as rows of `mcserver.motion.kernels.phases`."""
        first, last = self.span(low, high)
        rows = self.rows[first:last].copy()
        rows[0, 1:4] = self._inside(first, low)
        rows[0, 0] -= low - float(self.start[first])
        rows[-1, 0] -= self.end_of(last - 1) - high
        return rows

    def state(self, moment: float) -> tuple[float, float, float]:
        """Return coordinate, speed and acceleration at a time [s]; where acceleration steps, before the
        step.
        """
        return self._inside(max(int(np.searchsorted(self.start, moment, side="left")) - 1, 0), moment)

    def _inside(self, index: int, moment: float) -> tuple[float, float, float]:
        """Return coordinate, speed and acceleration at a time [s] of one phase."""
        _, p, v, a, j = self.rows[index].tolist()
        x = moment - float(self.start[index])
        return p + x * (v + x * (a / 2.0 + x * j / 6.0)), v + x * (a + x * j / 2.0), a + x * j

    def after(self, moment: float) -> Phases:
        """Return the profile after a time [s], with time and coordinate counted from there."""
        index = int(np.clip(np.searchsorted(self.start, moment, side="right") - 1, 0, len(self.start) - 1))
        here, speed, change = self._inside(index, moment)
        start = self.start[index:] - moment
        position = self.position[index:] - here
        velocity, acceleration = self.velocity[index:].copy(), self.acceleration[index:].copy()
        start[0], position[0] = 0.0, 0.0
        velocity[0], acceleration[0] = speed, change
        return Phases(
            start=start,
            duration=self.duration - moment,
            position=position,
            velocity=velocity,
            acceleration=acceleration,
            jerk=self.jerk[index:],
            end=self.end - here,
            sealed=self.sealed[index:],
        )

    def at(self, time: Array) -> tuple[Array, Array]:
        """Return coordinate and speed at ``time`` (n,) [s]; at rest before the start and after the end."""
        t = np.clip(time, 0.0, self.duration)
        phase = np.clip(np.searchsorted(self.start, t, side="right") - 1, 0, len(self.start) - 1)
        x = t - self.start[phase]
        a, j = self.acceleration[phase], self.jerk[phase]
        velocity = self.velocity[phase] + x * (a + x * j / 2.0)
        position = self.position[phase] + x * (self.velocity[phase] + x * (a / 2.0 + x * j / 6.0))
        done = time >= self.duration
        position[done] = self.end
        return np.minimum(position, self.end), np.maximum(velocity, 0.0)

    def time_at(self, positions: Array) -> Array:
        """Return the first times at which the coordinate reaches ``positions`` (n,), which increase [s]."""
        times: Array = np.empty(len(positions))
        times_at_positions(self.start, self.duration, self.rows, self.end, positions, NO_DISTANCE, times)
        return times


@dataclass(frozen=True)
class Profile:
    """One solved profile from 0 to ``distance``: durations and jerks of its phases.

    ``peak_velocity``, ``peak_acceleration`` tell what bound it.
    """

    duration: float
    times: list[float]
    jerks: list[float]
    accelerations: list[float]
    velocities: list[float]
    positions: list[float]
    peak_velocity: float
    peak_acceleration: float


class ProfileSolver:
    """Solves profiles on one coordinate; keeps Ruckig's objects, so use one per thread."""

    def __init__(self) -> None:
        self._ruckig = ruckig.Ruckig(1)
        self._input = ruckig.InputParameter(1)
        self._trajectory = ruckig.Trajectory(1)
        self._input.current_position = [0.0]
        self._input.current_acceleration = [0.0]
        self._input.target_acceleration = [0.0]

    def solve(
        self,
        distance: float,
        entry: float,
        exit_: float,
        velocity: float,
        acceleration: float,
        jerk: float,
        duration: float | None = None,
    ) -> Profile | None:
        """Solve the minimum-time profile over ``distance`` [m or rad], or the one that takes ``duration``
        [s].

        Speeds ``entry`` and ``exit_`` must not exceed ``velocity``; acceleration is 0 at both ends.

        Returns:
            None where no profile keeps the limits without going backwards, or none takes ``duration``.
        """
        solved: Profile | None = None
        for share in NUDGES:
            # exactly at the border between two shapes of profile the solver finds neither; just beside
            # it does
            solved = self._solve(
                distance, entry, exit_, velocity, share * acceleration, share * share * jerk, duration
            )
            if solved is not None:
                return solved
        if duration is not None:
            # a move that has plenty of time needs no more than a small part of the limits, and numbers of
            # very different sizes are beyond the solver
            feed_speed = distance / duration + max(entry, exit_)
            gentle = min(acceleration, PLENTY * feed_speed / duration)
            smooth = min(jerk, PLENTY**2 * feed_speed / duration**2)
            solved = self._solve(distance, entry, exit_, velocity, gentle, smooth, duration)
        return solved

    def _solve(
        self,
        distance: float,
        entry: float,
        exit_: float,
        velocity: float,
        acceleration: float,
        jerk: float,
        duration: float | None,
    ) -> Profile | None:
        given = self._input
        # the unit of the coordinate is scaled so that the distance is 1, for Ruckig's tolerances are
        # absolute; the unit of time so that no profile lasts longer than the 7600 s that Ruckig takes
        unit = max(1.0, (duration or 0.0) / LONGEST_S, distance / velocity / LONGEST_S)
        scale = unit / distance
        given.target_position = [1.0]
        given.current_velocity = [entry * scale]
        given.target_velocity = [exit_ * scale]
        given.max_velocity = [velocity * scale]
        given.max_acceleration = [acceleration * scale * unit]
        given.max_jerk = [jerk * scale * unit**2]
        given.minimum_duration = None if duration is None else duration / unit
        try:
            result = self._ruckig.calculate(given, self._trajectory)
        except (ruckig.RuckigError, ValueError):
            return None
        if result not in (ruckig.Result.Working, ruckig.Result.Finished):
            return None
        profile = self._trajectory.profiles[0][0]
        total = self._trajectory.duration * unit
        if duration is not None and total > duration * (1.0 + 1e-9) + 1e-9:
            return None
        # the solver arrives within some 1e-8 of the distance; a step of that size at the end would be seen as
        # acceleration at the cycle rate
        exact = 1.0 / profile.p[-1]
        times = [t * unit for t in profile.t]
        jerks = [j * exact / unit**3 for j in profile.j]
        velocities = [v * exact / unit for v in profile.v]
        accelerations = [a * exact / unit**2 for a in profile.a]
        positions = [p * exact for p in profile.p]
        # Ruckig may go back and forth where a monotone profile does not exist
        if min(velocities) < -1e-7 * max(1.0, max(velocities)) or _dips_below_zero(profile):
            return None
        if sum(profile.brake.t) > 0.0:
            return None
        top = max(velocities)
        return Profile(
            duration=total,
            times=times,
            jerks=[j * distance for j in jerks],
            accelerations=[a * distance for a in accelerations],
            velocities=[v * distance for v in velocities],
            positions=[p * distance for p in positions],
            peak_velocity=top * distance,
            peak_acceleration=max(abs(a) for a in accelerations) * distance,
        )


def _dips_below_zero(profile: ruckig.Profile) -> bool:
    """Return whether the speed is negative inside a phase (its ends are checked by the caller)."""
    for index in range(7):
        t, a, j = profile.t[index], profile.a[index], profile.j[index]
        if j > 0.0 and a < 0.0:
            vertex = -a / j
            if 0.0 < vertex < t and profile.v[index] + a * vertex / 2.0 < -1e-7:
                return True
    return False


def rows_of(profiles: list[Profile], origin: float = 0.0) -> Array:
    """Return consecutive profiles as phases, shape (n, `PHASE`), with the coordinate counted from
    ``origin``.
    """
    rows: list[tuple[float, ...]] = []
    for profile in profiles:
        for index, time in enumerate(profile.times):
            if time <= 0.0:
                continue
            a, j = profile.accelerations[index], profile.jerks[index]
            p, v = origin + profile.positions[index], profile.velocities[index]
            # a phase that passes zero acceleration is two: the moment between is where a plan may be cut
            turn = -a / j if j != 0.0 else 0.0
            if 1e-9 * time < turn < (1.0 - 1e-9) * time:
                rows.append((turn, p, v, a, j))
                p, v = p + turn * (v + turn * (a / 2.0 + turn * j / 6.0)), v + turn * a / 2.0
                a, time = 0.0, time - turn
            rows.append((time, p, v, a, j))
        origin += profile.positions[-1]
    return np.array(rows).reshape(-1, PHASE)


def join_phases(rows: Array, end: float, sealed: NDArray[np.bool_] | None = None) -> Phases:
    """Return the velocity profile of consecutive phases, shape (n, `PHASE`), that ends at the coordinate
    ``end``; ``sealed`` as of `Phases`, by default none.
    """
    until = np.cumsum(rows[:, 0])
    return Phases(
        start=until - rows[:, 0],
        duration=float(until[-1]),
        position=rows[:, 1].copy(),
        velocity=rows[:, 2].copy(),
        acceleration=rows[:, 3].copy(),
        jerk=rows[:, 4].copy(),
        end=end,
        sealed=np.zeros(len(rows), np.bool_) if sealed is None else sealed,
    )


def join(profiles: list[Profile]) -> Phases:
    """Return the phases of consecutive profiles as one velocity profile."""
    return join_phases(rows_of(profiles), sum(profile.positions[-1] for profile in profiles))
