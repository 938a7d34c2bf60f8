"""The pace of rows: how many of them are played in a cycle as they are planned.

It goes with the feed scale. So where a motion under way goes on at another feed scale, positions over u are
smooth: what is planned anew begins with the speed that the rows before have at its own pace.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits
from mcserver.motion.kernels.rate_search import CRUISE
from mcserver.motion.kernels.rate_trial import SETTLING

# A motion that begins at an override above 100 % has so many rows a cycle: it meets whole rows then, and has
# no fewer than one a cycle when it goes on at 100 %.
FASTER_PACE = 2.0
# Shares of a rise of the rate that are looked at, and what stands for no motion at all.
REACHABLE, TRACE = (1.0, 0.75, 0.5, 0.25), 1e-30
# Rows without which the jerk of others is not known, the one under way included.
DIFFERENCES = 3


@dataclass
class Pace:
    """Rows a cycle of what is planned next.

    Attributes:
        limits: of the axes. most: greatest pace. now: that of the motion under way.
        plain: that of this motion at 100 %. under_way: rows of it have been handed over.
    """

    limits: AxisLimits
    most: float = 1.0
    now: float = 1.0
    plain: float = 1.0
    under_way: bool = False

    @property
    def cycle(self) -> float:
        """Time between rows as they are planned [s]."""
        return self.limits.cycle / self.now

    def begin(self, scale: float) -> None:
        """Set the pace of a motion from rest at a feed scale."""
        self.now = FASTER_PACE if scale > 1.0 and self.most >= FASTER_PACE else 1.0
        self.plain = self.now / scale

    def end(self) -> None:
        """Note that the motion ends at rest."""
        self.now = self.plain = 1.0
        self.under_way = False

    def at(self, scale: float) -> float:
        """Return the pace at a feed scale [1]."""
        return min(max(self.plain * scale, 1.0), self.most)

    def reachable(self, scale: float, latest: Array | None, rate: float = 1.0) -> float:
        """Return the pace at a feed scale, or the rate that playback may have come to by the end of what is
        handed over, where that is less.

        Args:
            latest: velocities of the last rows, one cycle a row, shape (n, K) [m/s or rad/s].
            rate: at which the first of them is played at the least, where they leave room for that.
        """
        wanted = self.at(scale)
        if not self.under_way or wanted <= self.now:
            return wanted
        limits, cycle = self.limits, self.limits.cycle
        if latest is None or len(latest) < 3:
            return self.now
        acceleration = np.diff(latest, axis=0) / cycle
        jerk = np.diff(acceleration, axis=0) / cycle
        rooms = (
            limits.velocity / (np.abs(latest[2:]) + TRACE),
            np.sqrt(limits.acceleration / (np.abs(acceleration[1:]) + TRACE)),
            np.cbrt(limits.jerk / (np.abs(jerk) + TRACE)),
        )
        room = np.min(rooms, axis=(0, 2))
        for share in REACHABLE:
            goal = self.now + share * (wanted - self.now)
            known = bool((room >= goal).all())
            rows = self._rows_to(goal, max(self.now, min(rate, goal) if known else self.now), latest[-1])
            if rows <= len(room) and (room[-rows:] >= goal).all():
                return goal
        return self.now

    def rows_until(self, scale: float, velocity: Array, rate: float) -> int:
        """Return the rows behind which playback can have come to the pace at a feed scale.

        Args:
            velocity: of the rows there, shape (K,) [m/s or rad/s]. rate: of playback.
        """
        goal = self.at(scale)
        return self._rows_to(goal, max(self.now, min(rate, goal)), velocity) + DIFFERENCES

    def rows_and_back(self, scale: float, velocity: Array, rate: float) -> int:
        """Return the rows behind which playback can have come to the pace at a feed scale, kept it until it
        looks anew, and come back to the present one: each rise is decided with that.

        Args:
            velocity, rate: as of `rows_until`.
        """
        goal = self.at(scale)
        now = max(self.now, min(rate, goal))
        rises = 0.5 * (goal + now) * self._cycles_to(goal, now, velocity)
        falls = 0.5 * (goal + self.now) * self._cycles_to(goal, self.now, velocity)
        return math.ceil(rises + falls + goal * (CRUISE + 1)) + SETTLING + DIFFERENCES

    def _rows_to(self, goal: float, now: float, velocity: Array) -> int:
        """Return the rows that a change of the rate passes at most, from now to a goal [1]."""
        return math.ceil(goal * self._cycles_to(goal, now, velocity)) + 1

    def _cycles_to(self, goal: float, now: float, velocity: Array) -> float:
        """Return the time of a change of the rate from now to a goal [cycles]."""
        limits, change = self.limits, (goal - now) * np.abs(velocity)
        ramp = np.where(
            change * limits.jerk > limits.acceleration**2,
            change / limits.acceleration + limits.acceleration / limits.jerk,
            2.0 * np.sqrt(change / limits.jerk),
        )
        return float(ramp.max()) / limits.cycle
