"""Plans of the playback rate on the cycle grid.

Time is counted in cycles and u in rows, one row a cycle at a rate of 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mcserver.executor.entries import Array


@dataclass(frozen=True)
class RatePhase:
    """A part of a plan: its start [cycles], the rows passed before it, and the rate, its slope and its
    curvature at the start.
    """

    start: float
    passed: float
    rate: float
    slope: float
    curvature: float

    def at(self, t: float) -> tuple[float, float, float]:
        """Return the rows passed since the plan's start, the rate and its slope after t cycles."""
        rate, slope, curvature = self.rate, self.slope, self.curvature
        return (
            self.passed + t * (rate + t * (slope / 2.0 + t * curvature / 6.0)),
            rate + t * (slope + t * curvature / 2.0),
            slope + t * curvature,
        )


@dataclass(frozen=True)
class RatePlan:
    """Rates of the cycles to come.

    Attributes:
        phases: at least one, the last one at the target. cycles: its duration.
        target: the steady rate at its end.
    """

    phases: tuple[RatePhase, ...]
    cycles: int
    target: float

    def __len__(self) -> int:
        return self.cycles

    @classmethod
    def of(cls, phases: Array, target: float, steady: int = 0) -> RatePlan:
        """Return the plan of phases, shape (n, 4) as in `rate_changes`, and ``steady`` cycles after them.

        A plan that ends within a cycle goes on at its target until the cycle ends.
        """
        parts = []
        start = passed = 0.0
        for duration, rate, slope, curvature in phases.tolist():
            parts.append(RatePhase(start, passed, rate, slope, curvature))
            start += duration
            passed += duration * (rate + duration * (slope / 2.0 + duration * curvature / 6.0))
        parts.append(RatePhase(start, passed, target, 0.0, 0.0))
        return cls(tuple(parts), math.ceil(start - 1e-9) + steady, target)

    def at(self, cycle: int) -> tuple[float, float, float]:
        """Return the rows passed since the plan's start at the end of a cycle, the rate there, and its
        slope.
        """
        phases = self.phases
        number = len(phases) - 1
        # a cycle that ends with a phase belongs to it
        while number > 0 and cycle <= phases[number].start:
            number -= 1
        return phases[number].at(cycle - phases[number].start)
