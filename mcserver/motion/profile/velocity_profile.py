"""A velocity profile along one path coordinate as phases of constant jerk.

A whole motion is sampled with numpy at once, and its duration is exact, not rounded to the cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.phases import times_at_positions
from mcserver.motion.kernels.ramp_kernels import NO_DISTANCE


@dataclass(frozen=True)
class Phases:
    """Consecutive phases of constant jerk.

    Attributes:
        start: times at which the phases begin, shape (n,) [s], increasing.
        duration: total duration [s].
        position, velocity, acceleration, jerk: at the beginning of each phase, shape (n,).
        end: position at the end of the last phase; beyond it the coordinate stays there.
        uncut: phases at whose start, and inside of which, the profile is not cut, shape (n,).
    """

    start: Array
    duration: float
    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    end: float
    uncut: NDArray[np.bool_]

    @cached_property
    def rows(self) -> Array:
        """The phases as rows of `mcserver.motion.kernels.phases`."""
        lasts = np.diff(self.start, append=self.duration)
        return np.column_stack((lasts, self.position, self.velocity, self.acceleration, self.jerk))

    def end_of(self, index: int) -> float:
        """Return when a phase ends [s]."""
        return float(self.start[index + 1]) if index + 1 < len(self.start) else self.duration

    def span(self, low: float, high: float) -> tuple[int, int]:
        """Return the range of phases under way between two times [s]: the first, and one past the last."""
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
        """Return coordinate, speed and acceleration at a time [s]; at a step of acceleration, before it."""
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
            uncut=self.uncut[index:],
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


def join_phases(rows: Array, end: float, uncut: NDArray[np.bool_] | None = None) -> Phases:
    """Return the velocity profile of consecutive phases, shape (n, `PHASE`), that ends at the coordinate
    ``end``; ``uncut`` as of `Phases`, by default none.
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
        uncut=np.zeros(len(rows), np.bool_) if uncut is None else uncut,
    )
