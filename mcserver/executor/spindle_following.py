"""Estimate the measured state of an axis, such as a spindle, and let plan time follow it."""

from __future__ import annotations

import math

from mcserver.motion.thread_cam import RateLimits

# Poles of the encoder's filter, and of the time that follows it [1/s].
FILTER, FOLLOWER = 400.0, 200.0
# Greatest |rate| of plan time: a plan is played up to its own speed, and backwards while the spindle
# reverses.
MOST_RATE = 1.0


class MeasuredPlace:
    """Estimates position, speed and acceleration of an axis from its encoder, read once per cycle.

    A fading-memory filter of the third order (Brookner, Tracking and Kalman Filtering Made Easy, 1998,
    ch. 1), which has no lag at constant acceleration.

    Attributes:
        place, speed, acceleration: at the newest reading, in units of the readings. count: of readings.
    """

    def __init__(self, cycle_s: float) -> None:
        fading = math.exp(-FILTER * cycle_s)
        self._gains = (
            1.0 - fading**3,
            1.5 * (1.0 - fading) ** 2 * (1.0 + fading) / cycle_s,
            (1.0 - fading) ** 3 / cycle_s**2,
        )
        self._cycle_s = cycle_s
        self.place = self.speed = self.acceleration = 0.0
        self.count = 0

    def take(self, place: float) -> None:
        """Add the reading of a cycle."""
        if self.count == 0:
            self.place = place
        elif self.count == 1:
            self.speed = (place - self.place) / self._cycle_s
            self.place = place
        else:
            expected, speed, _ = self.ahead(self._cycle_s)
            missed = place - expected
            by_place, by_speed, by_acceleration = self._gains
            self.place = expected + by_place * missed
            self.speed = speed + by_speed * missed
            self.acceleration += by_acceleration * missed
        self.count += 1

    def ahead(self, seconds: float) -> tuple[float, float, float]:
        """Extrapolate position, speed and acceleration by some time after the newest reading."""
        place = self.place + seconds * (self.speed + 0.5 * seconds * self.acceleration)
        return place, self.speed + seconds * self.acceleration, self.acceleration


class FollowedTime:
    """A time that follows another within limits of its rate's slope and curvature.

    Attributes:
        time, rate, slope: of it [s, 1, 1/s].
    """

    def __init__(self, time: float, rate: float, slope: float) -> None:
        self.time, self.rate, self.slope = time, rate, slope

    def step(self, goal: tuple[float, float, float], limits: RateLimits, cycle_s: float) -> None:
        """Advance by a cycle towards ``goal``: time, rate and slope at its end."""
        time, goal_rate, slope = goal
        most, change = limits.slope, limits.curvature * cycle_s
        wanted = (
            FOLLOWER**3 * (time - self.time - cycle_s * (self.rate + 0.5 * cycle_s * self.slope))
            + 3.0 * FOLLOWER**2 * (goal_rate - self.rate - cycle_s * self.slope)
            + 3.0 * FOLLOWER * (slope - self.slope)
        )
        # a slope that can come to 0 before the rate reaches its bound, and within the slope's own limits
        passing = abs(self.slope) * cycle_s
        rising, falling = (
            math.sqrt(2.0 * limits.curvature * max(0.0, MOST_RATE - rate - passing))
            for rate in (self.rate, -self.rate)
        )
        high = max(min(most, rising), self.slope - change)
        low = min(max(-most, -falling), self.slope + change)
        after = self.slope + min(change, max(-change, wanted * cycle_s))
        after = min(max(after, low), high)
        curvature = (after - self.slope) / cycle_s
        self.time += cycle_s * (self.rate + cycle_s * (0.5 * self.slope + cycle_s * curvature / 6.0))
        self.rate += cycle_s * (self.slope + 0.5 * cycle_s * curvature)
        self.slope = after
