"""A thread as an electronic cam: position along its line as a function of the spindle's angle.

The cam is planned over time at the greatest speed of the spindle: a ramp from rest to the speed of the pitch,
a cruise, and a ramp to rest. The executor lets this plan time pass in proportion to the spindle's angle, so
the lead is the pitch at any lower spindle speed, and passes at different speeds cut the same groove.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mcserver.machine.axis import Axis
from mcserver.units import TURN

# Greatest speed of the spindle, as a multiple of its S.
MOST_SPEED = 1.1
# Shares of the axes' acceleration and jerk that ramps are planned with; the rest is for changes of the
# spindle's speed.
RAMP_ACCELERATION, RAMP_JERK = 0.7, 0.5
# Shares of the jerk on a ramp for the terms 3·a·ṙ and v·r̈, r being spindle speed / greatest speed.
_OF_SLOPE, _OF_CURVATURE = 0.25, 0.25
# An axis without a jerk limit is planned to reach its acceleration in this time [s].
JERK_TIME_S = 0.005
# Plan time before the ramp to rest in which changes of speed decay to what a ramp allows [s].
APPROACH_S = 0.05
# Margin for the rounding of setpoint differences over a cycle.
_ROUNDING = 0.98


@dataclass(frozen=True)
class RateLimits:
    """Limits of changes of the rate r: its slope ṙ [1/s] and its curvature r̈ [1/s²]."""

    slope: float
    curvature: float


@dataclass(frozen=True)
class ThreadCam:
    """The cam of one pass.

    Attributes:
        length: of the line [m]. speed: of the cruise [m/s].
        greatest_speed, acceleration, jerk: limits of the axes along the line [m/s, m/s², m/s³].
        taps: the cruise has no end: the spindle reverses, and the cam is played backwards to its start.
    """

    length: float
    speed: float
    greatest_speed: float
    acceleration: float
    jerk: float
    taps: bool = False

    @property
    def _peak(self) -> float:
        return min(RAMP_ACCELERATION * self.acceleration, math.sqrt(self.speed * RAMP_JERK * self.jerk))

    @property
    def ramp_s(self) -> float:
        """Plan time of each ramp [s]."""
        return self.speed / self._peak + self._peak / (RAMP_JERK * self.jerk)

    @property
    def ramp_length(self) -> float:
        """Length of each ramp, on which the lead is less than the pitch [m]."""
        return 0.5 * self.speed * self.ramp_s

    @property
    def duration(self) -> float:
        """Plan time of the pass [s]; infinite where it has no end."""
        return math.inf if self.taps else self.length / self.speed + self.ramp_s

    def at(self, time: float) -> tuple[float, float, float]:
        """Return position, velocity and acceleration along the line at a plan time [m, m/s, m/s²]."""
        if 2.0 * time > self.duration:
            place, speed, acceleration = self._from_rest(self.duration - time)
            return self.length - place, speed, -acceleration
        return self._from_rest(time)

    def _from_rest(self, time: float) -> tuple[float, float, float]:
        if time <= 0.0:
            return 0.0, 0.0, 0.0
        peak, jerk, ramp = self._peak, RAMP_JERK * self.jerk, self.ramp_s
        rise, left = peak / jerk, ramp - time
        if time < rise:
            return jerk * time**3 / 6.0, 0.5 * jerk * time**2, jerk * time
        if left > rise:
            on = time - rise
            speed = 0.5 * peak * rise
            return peak * rise**2 / 6.0 + speed * on + 0.5 * peak * on**2, speed + peak * on, peak
        if left > 0.0:
            place = self.ramp_length - self.speed * left + jerk * left**3 / 6.0
            return place, self.speed - 0.5 * jerk * left**2, jerk * left
        return self.ramp_length - self.speed * left, self.speed, 0.0

    def follows(self, acceleration: float) -> bool:
        """Return whether the cruise can follow an acceleration of the spindle.

        Args:
            acceleration: of the spindle, times the pitch [m/s²].
        """
        return acceleration / self.speed <= self.rate_limits(0.5 * self.duration).slope

    def rate_limits(self, time: float) -> RateLimits:
        """Return the limits of changes of the rate that keep every axis's limits at a plan time.

        With s(τ), τ̇ = r: s̈ = s''·r² + s'·ṙ, and s⃛ = s'''·r³ + 3·s''·r·ṙ + s'·r̈, at rates of 0 to 1.
        """
        slope = min(
            (1.0 - RAMP_ACCELERATION) * self.acceleration / self.speed,
            _OF_SLOPE * self.jerk / (3.0 * RAMP_ACCELERATION * self.acceleration),
        )
        curvature = _OF_CURVATURE * self.jerk / self.speed
        margin = 1.2 * APPROACH_S
        begin = self.ramp_s + margin if self.taps else self.ramp_s
        if time < begin or time > self.duration - self.ramp_s - margin:
            return RateLimits(_ROUNDING * slope, _ROUNDING * curvature)
        steady = min(self.acceleration / self.speed, slope + APPROACH_S * curvature)
        return RateLimits(_ROUNDING * steady, _ROUNDING * self.jerk / self.speed)


def stopping_seconds(spindle: Axis, turns_s: float) -> float:
    """Return the stopping time of a spindle under its acceleration and jerk limits [s]."""
    speed, acceleration, jerk = turns_s * TURN, spindle.max_acceleration, spindle.max_jerk
    rise = min(acceleration / jerk, math.sqrt(speed / jerk))
    return speed / acceleration + rise if speed * jerk >= acceleration**2 else 2.0 * rise


def stopping_turns(spindle: Axis, turns_s: float) -> float:
    """Return the turns that a spindle needs to stop under its acceleration and jerk limits [1]."""
    return 0.5 * turns_s * stopping_seconds(spindle, turns_s)


def least_tapping(cam: ThreadCam, stopping: float) -> float:
    """Return the least length of a tapping move: the spindle has to reverse on the cruise [m].

    Args:
        stopping: travel while the spindle stops [m].
    """
    return cam.ramp_length + 1.2 * APPROACH_S * cam.speed + stopping


def plan_cam(
    axes: Sequence[Axis], travel: Sequence[float], pitch: float, turns_s: float, *, taps: bool = False
) -> ThreadCam:
    """Plan a pass along a straight line.

    Args:
        axes, travel: the axes, and the travel of each [m]. pitch: travel along the line per turn [m].
        turns_s: the spindle's S [1/s].
    """
    length = math.hypot(*travel)
    moving = [(axis, abs(each) / length) for axis, each in zip(axes, travel, strict=True) if each]
    acceleration = min(axis.max_acceleration / share for axis, share in moving)
    jerk = min(axis.max_jerk / share for axis, share in moving)
    return ThreadCam(
        length,
        pitch * turns_s * MOST_SPEED,
        min(axis.max_velocity / share for axis, share in moving),
        acceleration,
        min(jerk, acceleration / JERK_TIME_S),
        taps,
    )
