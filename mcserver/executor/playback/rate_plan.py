"""Changes of the playback rate: s-curves in closed form, and plans made of them, on the cycle grid.

Time is counted in cycles and u in rows, one row a cycle at a rate of 1. The rate's slope r' [1/cycle] bounds
the acceleration that a change of rate adds along the path, and r'' [1/cycle²] the jerk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcserver.executor.headroom import Array

# A change of rate below this is none [1].
SAME_RATE = 1e-12


@dataclass(frozen=True)
class RateLimits:
    """Largest slope r' [1/cycle] and curvature r'' [1/cycle²] of the rate; the latter may be infinite."""

    slope: float
    curvature: float

    def scaled(self, share: float) -> RateLimits:
        """Return both limits times ``share``."""
        return RateLimits(self.slope * share, self.curvature * share)


@dataclass(frozen=True)
class RatePhase:
    """A part of a plan: duration [cycles], and the rate, its slope and its curvature at the start."""

    duration: float
    rate: float
    slope: float
    curvature: float

    @property
    def advance(self) -> float:
        """Rows that u passes."""
        t = self.duration
        return t * (self.rate + t * (self.slope / 2.0 + t * self.curvature / 6.0))


def ramp(rate: float, slope: float, target: float, limits: RateLimits) -> list[RatePhase]:
    """Return the fastest change from a rate with a slope to a steady target rate, at most three phases."""
    most, curvature = limits.slope, limits.curvature
    if math.isinf(curvature):
        change = target - rate
        if abs(change) <= SAME_RATE:
            return []
        return [RatePhase(abs(change) / most, rate, math.copysign(most, change), 0.0)]
    # up or down from the rate that is reached once the slope has been taken back
    up = 1.0 if target >= rate + 0.5 * slope * abs(slope) / curvature else -1.0
    square = max(curvature * up * (target - rate) + 0.5 * slope * slope, 0.0)
    peak = min(math.sqrt(square), max(most, up * slope))
    first = (peak - up * slope) / curvature
    hold = max((square - peak * peak) / (curvature * peak), 0.0) if peak > 0.0 else 0.0
    phases = []
    for duration, change in ((first, up * curvature), (hold, 0.0), (peak / curvature, -up * curvature)):
        if duration > 0.0:
            phases.append(RatePhase(duration, rate, slope, change))
            rate += duration * (slope + 0.5 * duration * change)
            slope += duration * change
    return phases


def total_time(phases: list[RatePhase]) -> float:
    """Return the duration of phases [cycles]."""
    return sum(phase.duration for phase in phases)


def total_advance(phases: list[RatePhase]) -> float:
    """Return the rows that u passes in phases."""
    return sum(phase.advance for phase in phases)


@dataclass(frozen=True)
class RatePlan:
    """Rates of the cycles to come.

    Attributes:
        advance: rows from the plan's start to the end of each cycle, shape (n,). rate, slope: at the end of
            each cycle, shape (n,). target: the steady rate at its end.
    """

    advance: Array
    rate: Array
    slope: Array
    target: float

    def __len__(self) -> int:
        return len(self.advance)

    @classmethod
    def of(cls, phases: list[RatePhase], target: float, steady: int = 0) -> RatePlan:
        """Sample phases at the end of each cycle, up to ``steady`` cycles after the last one.

        A plan that ends within a cycle goes on at its target until the cycle ends.
        """
        ends = np.cumsum([phase.duration for phase in phases]) if phases else np.zeros(0)
        count = (math.ceil(float(ends[-1]) - 1e-9) if phases else 0) + steady
        time = np.arange(1.0, count + 1.0)
        at = np.searchsorted(ends, time, side="left")
        rows = np.array(
            [(phase.rate, phase.slope, phase.curvature) for phase in phases] + [(target, 0.0, 0.0)]
        )
        starts = np.concatenate(([0.0], ends))
        passed = np.concatenate(([0.0], np.cumsum([phase.advance for phase in phases])))
        t = time - starts[at]
        rate, slope, curvature = rows[at].T
        return cls(
            advance=passed[at] + t * (rate + t * (slope / 2.0 + t * curvature / 6.0)),
            rate=rate + t * (slope + t * curvature / 2.0),
            slope=slope + t * curvature,
            target=target,
        )
