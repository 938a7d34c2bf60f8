"""The playback rate of a program and how it changes: overrides and feed hold, along the path, within
limits.
"""

from __future__ import annotations

import math

from mcserver.executor.headroom import RATE_MAX, SLOPE_MAX

# Time in which the slope of the rate builds up and fades [s].
SMOOTHING_S = 0.004
# Share of an axis's acceleration that a change of the rate may use up, and what it may use where none is
# left.
USED_SHARE = 0.995
FLOOR_SHARE = 0.01
# Below this distance from its target the rate is there [1].
NEAR = 1e-9


class RateAccelerationLimits:
    """Largest slopes at which the rate may fall and rise so that |r²·q'' + r'·q'| stays within every axis's
    limit.

    Attributes:
        down, up: [1/s], both positive.
    """

    __slots__ = ("down", "up")

    def __init__(self, down: float = SLOPE_MAX, up: float = SLOPE_MAX) -> None:
        self.down = down
        self.up = up

    def limit(self, speed: float, along: float, acceleration: float) -> None:
        """Take one axis into account.

        Args:
            speed: |q'| [m/s, rad/s]. along: r²·q'' in the direction of motion, negative where it brakes.
            acceleration: the axis's limit.
        """
        if speed <= 0.0:
            return
        floor = FLOOR_SHARE * acceleration
        room = USED_SHARE * acceleration
        self.down = min(self.down, max(room + along, floor) / speed)
        self.up = min(self.up, max(room - along, floor) / speed)


class RateRamp:
    """A rate on its way to a target.

    Attributes:
        rate: at the end of this cycle [1]. before: at its beginning. slope: its change [1/s].
    """

    __slots__ = ("_cycle", "before", "rate", "slope")

    def __init__(self, cycle_s: float, rate: float = 1.0) -> None:
        self._cycle = cycle_s
        self.rate = self.before = rate
        self.slope = 0.0

    @property
    def mean(self) -> float:
        """What passes in this cycle [cycles]."""
        return 0.5 * (self.before + self.rate)

    def at(self, left: float) -> float:
        """The rate when ``left`` of this cycle remains [1]."""
        return self.rate + (self.before - self.rate) * left

    def begin_cycle(self) -> None:
        """A cycle begins, in which the rate stays unless it is told otherwise."""
        self.before = self.rate

    def jump(self, rate: float) -> None:
        """At once: nothing moves by this rate."""
        self.rate = self.before = rate
        self.slope = 0.0

    def step(self, target: float, slopes: RateAccelerationLimits) -> None:
        """One cycle: the slope is limited, and builds up and fades within `SMOOTHING_S`."""
        cycle = self._cycle
        error = target - self.rate
        bound = slopes.up if error > 0.0 else slopes.down
        change = bound / max(SMOOTHING_S, cycle) * cycle
        # the slope from which it can fade to 0 in steps of `change` right at the target
        fading = math.sqrt(0.25 * change * change + 2.0 * change * abs(error) / cycle) - 0.5 * change
        wanted = math.copysign(min(bound, fading), error)
        if self.slope * error < 0.0:
            # it runs away from its target: that ends as fast as it began
            change = max(
                change, max(slopes.up, slopes.down, abs(self.slope)) / max(SMOOTHING_S, cycle) * cycle
            )
        slope = self.slope + max(-change, min(change, wanted - self.slope))
        slope = max(-slopes.down, min(slopes.up, slope))
        rate = self.rate + slope * cycle
        if (target - rate) * error <= 0.0 or abs(target - rate) < NEAR:
            rate, slope = target, 0.0
        self.rate = max(0.0, min(RATE_MAX, rate))
        self.slope = slope
