"""A part of a quintic spline as a curve: replaces one of many short programmed lines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array, Curve
from mcserver.motion.geometry.segment import Segment
from mcserver.motion.kernels.spline_samples import SAMPLES_A_SPAN, spline_at


@dataclass(frozen=True, eq=False)
class Spline:
    """A quintic spline, at least three times continuously differentiable.

    Attributes:
        breaks: parameters where its m spans begin and end, shape (m+1,). spans: their polynomials in the
            distance from their start, constant first, shape (m, 6, K) [m or rad].
        end: exact end position, shape (K,).
    """

    breaks: Array
    spans: Array
    end: Array

    def at(self, t: Array) -> Array:
        """Return positions and three derivatives by t, shape (4, n, K)."""
        found = np.empty((4, len(t), self.spans.shape[2]))
        spline_at(self.breaks, self.spans, t, found)
        return found


class SplineCurve(Curve, frozen=True, eq=False):
    """The part of a spline between two parameters; s goes from 0 to 1 with the parameter.

    Attributes:
        axes: machine columns, K of them. low, high: parameters at s = 0 and 1.
    """

    spline: Spline
    low: float
    high: float

    def position(self, s: Array) -> Array:
        places: Array = self.spline.at(self._t(s))[0]
        if self.high >= self.spline.breaks[-1]:
            # a target is met to the last bit
            places[np.asarray(s) >= 1.0] = self.spline.end
        return places

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        found = self.spline.at(self._t(s))
        span = self.high - self.low
        return found[1] * span, found[2] * span**2, found[3] * span**3

    def samples(self) -> Array:
        """Values of s at which limits are evaluated, from 0 to 1."""
        breaks = self.spline.breaks
        inside: NDArray[np.intp] = np.nonzero((breaks > self.low) & (breaks < self.high))[0]
        first = max(int(np.searchsorted(breaks, self.low, side="right")) - 1, 0)
        last = min(int(inside[-1]) + 1 if len(inside) else first + 1, len(breaks) - 1)
        step = float(np.diff(breaks[first : last + 1]).min()) / SAMPLES_A_SPAN
        count = max(1, math.ceil((self.high - self.low) / step - 1e-9))
        places: Array = np.linspace(0.0, 1.0, count + 1)
        return places

    def _t(self, s: Array) -> Array:
        t: Array = self.low + np.asarray(s, dtype=np.float64) * (self.high - self.low)
        return t


def spline_part(segment: Segment) -> SplineCurve | None:
    """Return the spline part of a segment; None where its curve is something else."""
    curve = segment.curves[0] if segment.curves else None
    return curve if isinstance(curve, SplineCurve) else None
