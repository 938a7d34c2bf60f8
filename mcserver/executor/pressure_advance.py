"""Pressure advance in the cycle: what E gets besides what is ordered, from the last cycles' flow (D-143).

The flow is E's real speed, whatever orders it: overrides and holds count. It is a continuous function of the
speeds of E and of the path, so a print and a prime, or E alone, go over into each other without a step.
"""

from __future__ import annotations

import math

import numpy as np

from mcserver.executor.entries import Array
from mcserver.machine.advance_section import Lead


class PressureAdvance:
    """The flow of the last cycles, and what E is led by it.

    Args:
        length: cycles that are kept.

    Attributes:
        column: of E. last: in how many cycles behind the end of its motion it is where it was ordered.
        gain: K [s]. offset, velocity: by which E is led [m, m/s].
    """

    def __init__(self, lead: Lead, length: int, cycle_s: float) -> None:
        own = lead.own
        self.column, self.last, self.gain = lead.column, len(lead.weights), own.initial
        self._path, self._per_length, self._most = list(lead.path), own.per_length, own.flow
        self._cycle, self._length = cycle_s, length
        # the oldest first, as in the rings
        self._weights = np.zeros(length)
        self._weights[length - len(lead.weights) :] = lead.weights[::-1]
        self._flows = np.zeros(2 * length)
        self._next = self.gain
        self._mean = self.offset = self.velocity = 0.0

    def choose(self, gain: float) -> None:
        """Take another K, from where no flow counts: that moves nothing."""
        self._next = gain
        if self._mean == 0.0:
            self.gain = gain

    def lead(self, at: int, step: Array) -> None:
        """Let a cycle pass.

        Args:
            at: of it in the rings. step: what axes are ordered to go in it, shape (K,) [m or rad].
        """
        pushed, gone = float(step[self.column]), math.hypot(*step[self._path].tolist())
        flow = min(max(pushed, 0.0) / self._cycle, self._per_length * gone / self._cycle, self._most)
        self._flows[at] = self._flows[at + self._length] = flow
        # a sum of nothing but zeros is 0: E is exactly where it was ordered then
        self._mean = float(self._flows[at + 1 : at + 1 + self._length] @ self._weights)
        offset = self.gain * self._mean
        self.velocity = (offset - self.offset) / self._cycle
        self.offset = offset
        if self._mean == 0.0:
            self.gain = self._next

    def clear(self) -> None:
        """Forget the flow: E goes on from where its drive is."""
        self._flows[:] = 0.0
        self._mean = self.offset = self.velocity = 0.0
