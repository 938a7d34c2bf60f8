"""Exact curves p(s) over axes, s in [0, 1]: lines, arcs, helices, and joint paths of tools.

A curve knows which axes it moves and gives position and the first three derivatives with respect to s at
any s. Nothing is chopped into chords: sampling happens only at the cycle. All quantities are SI (m, rad).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Curve(Protocol):
    """A path over ``axes`` (axis numbers, in the order of the columns)."""

    @property
    def axes(self) -> tuple[int, ...]: ...

    @property
    def length(self) -> float:
        """Length of the programmed path (D-30): m for linear axes and tools, rad for rotary ones."""

    def position(self, s: Array) -> Array:
        """Positions, shape (len(s), len(axes)) [m or rad]."""

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        """dp/ds, d²p/ds², d³p/ds³, each of shape (len(s), len(axes))."""

    def bounds(self) -> tuple[Array, Array]:
        """Return the least and greatest position of each axis on the whole curve, shape (len(axes),) each."""


class LineCurve(msgspec.Struct, frozen=True):
    """A straight line in joint space; an axis that is named but does not travel stays in ``axes``.

    ``length`` is given by whoever knows the axes' types (D-30); it has no influence on the shape.
    """

    axes: tuple[int, ...]
    start: tuple[float, ...]
    end: tuple[float, ...]
    length: float = 0.0

    def position(self, s: Array) -> Array:
        start = np.asarray(self.start)
        end = np.asarray(self.end)
        points: Array = start + np.asarray(s)[:, None] * (end - start)
        # start + (end - start) need not be end in floating point; the target is exact
        points[np.asarray(s) >= 1.0] = end
        return points

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        travel = np.asarray(self.end) - np.asarray(self.start)
        first: Array = np.broadcast_to(travel, (len(s), len(self.axes))).copy()
        return first, np.zeros_like(first), np.zeros_like(first)

    def bounds(self) -> tuple[Array, Array]:
        start = np.asarray(self.start)
        end = np.asarray(self.end)
        return np.minimum(start, end), np.maximum(start, end)


class ArcCurve(msgspec.Struct, frozen=True):
    """A circular arc, helix or spiral of D-22.

    The first two of ``axes`` are the plane's axes (first, second) in right-handed order seen from the
    plane's positive normal: (X, Y) for G17, (Z, X) for G18, (Y, Z) for G19. Further axes go linearly with
    the angle. The radius goes linearly from its start to its end value over the sweep.

    Attributes:
        start, end: shape (len(axes),), positions at s = 0 and s = 1; the plane's axes come first.
        centre: (first, second) of the centre.
        sweep: total angle with all turns [rad]; positive is counter-clockwise (G03).
        length: arc length in the plane, or helix length with the further axes [m].
    """

    axes: tuple[int, ...]
    start: tuple[float, ...]
    end: tuple[float, ...]
    centre: tuple[float, float]
    sweep: float
    length: float

    @property
    def start_angle(self) -> float:
        """Angle of the start point about the centre [rad]."""
        return math.atan2(self.start[1] - self.centre[1], self.start[0] - self.centre[0])

    @property
    def start_radius(self) -> float:
        return math.hypot(self.start[0] - self.centre[0], self.start[1] - self.centre[1])

    @property
    def end_radius(self) -> float:
        return math.hypot(self.end[0] - self.centre[0], self.end[1] - self.centre[1])

    def position(self, s: Array) -> Array:
        s = np.asarray(s, dtype=float)
        angle = self.start_angle + self.sweep * s
        radius = self.start_radius + (self.end_radius - self.start_radius) * s
        points = np.empty((len(s), len(self.axes)))
        points[:, 0] = self.centre[0] + radius * np.cos(angle)
        points[:, 1] = self.centre[1] + radius * np.sin(angle)
        start = np.asarray(self.start[2:])
        points[:, 2:] = start + s[:, None] * (np.asarray(self.end[2:]) - start)
        # the programmed endpoints are exact, whatever the rounding of cos and sin
        points[s <= 0.0] = self.start
        points[s >= 1.0] = self.end
        return points

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        s = np.asarray(s, dtype=float)
        angle = self.start_angle + self.sweep * s
        cos, sin = np.cos(angle), np.sin(angle)
        w = self.sweep
        growth = self.end_radius - self.start_radius
        radius = self.start_radius + growth * s
        first = np.zeros((len(s), len(self.axes)))
        second = np.zeros_like(first)
        third = np.zeros_like(first)
        first[:, 0] = growth * cos - radius * w * sin
        first[:, 1] = growth * sin + radius * w * cos
        second[:, 0] = -2.0 * growth * w * sin - radius * w * w * cos
        second[:, 1] = 2.0 * growth * w * cos - radius * w * w * sin
        third[:, 0] = -3.0 * growth * w * w * cos + radius * w**3 * sin
        third[:, 1] = -3.0 * growth * w * w * sin - radius * w**3 * cos
        first[:, 2:] = np.asarray(self.end[2:]) - np.asarray(self.start[2:])
        return first, second, third

    def bounds(self) -> tuple[Array, Array]:
        low = np.minimum(self.start, self.end)
        high = np.maximum(self.start, self.end)
        # extrema in the plane lie at the quarter angles; those of a spiral are shifted by atan(r'/r)
        growth = self.end_radius - self.start_radius
        first, last = sorted((self.start_angle, self.start_angle + self.sweep))
        candidates = []
        for quarter in range(4):
            angle = quarter * math.pi / 2.0
            turns = math.ceil((first - angle) / (2.0 * math.pi) - 1.0)
            while angle + turns * 2.0 * math.pi <= last + math.pi / 2.0:
                s = (angle + turns * 2.0 * math.pi - self.start_angle) / self.sweep
                for _ in range(3):
                    radius = self.start_radius + growth * min(max(s, 0.0), 1.0)
                    shift = math.atan2(growth / self.sweep, radius)
                    s = (angle + shift + turns * 2.0 * math.pi - self.start_angle) / self.sweep
                candidates.append(s)
                turns += 1
        inside = np.array([s for s in candidates if 0.0 < s < 1.0])
        if len(inside):
            points = self.position(inside)
            low = np.minimum(low, points.min(axis=0))
            high = np.maximum(high, points.max(axis=0))
        return low, high


class SampledCurve(msgspec.Struct, frozen=True):
    """A joint path as a cubic spline over knots of s: what inverse kinematics gives for a tool's path.

    Attributes:
        axes: K axis numbers.
        knots: shape (M,), increasing from 0 to 1.
        coefficients: shape (4, M-1, K), highest power first, in (s - knots[i]) (as scipy's PPoly).
        length: of the tool's path [m], or the angle of a pure rotation [rad].
        tool_rates: positions of the axes, shape (n, K) → shape (n, 3 or 6, K): rates of the tool's point [m]
            and of its turn [rad] by those of the axes; None where they are not known: its corners stay.
    """

    axes: tuple[int, ...]
    knots: Array
    coefficients: Array
    length: float
    tool_rates: Callable[[Array], Array] | None = None

    def _cell(self, s: Array) -> tuple[Array, NDArray[np.intp]]:
        cell = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.knots) - 2)
        return np.asarray(s)[:, None] - self.knots[cell][:, None], cell

    def position(self, s: Array) -> Array:
        x, cell = self._cell(s)
        c3, c2, c1, c0 = self.coefficients[:, cell]
        result: Array = ((c3 * x + c2) * x + c1) * x + c0
        return result

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        x, cell = self._cell(s)
        c3, c2, c1, _ = self.coefficients[:, cell]
        return (3.0 * c3 * x + 2.0 * c2) * x + c1, 6.0 * c3 * x + 2.0 * c2, 6.0 * c3

    def bounds(self) -> tuple[Array, Array]:
        fine = np.unique(np.concatenate([np.linspace(0.0, 1.0, 257), self.knots]))
        return span_of(self.position(fine))


class PolynomialCurve(msgspec.Struct, frozen=True):
    """A polynomial of degree n in s: what rounds a corner.

    Attributes:
        axes: K axis numbers.
        coefficients: shape (n+1, K), constant term first [m or rad].
        length: measured along the curve [m or rad].
    """

    axes: tuple[int, ...]
    coefficients: Array
    length: float

    def position(self, s: Array) -> Array:
        return _horner(self.coefficients, s)

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        first = _derivative(self.coefficients)
        second = _derivative(first)
        return _horner(first, s), _horner(second, s), _horner(_derivative(second), s)

    def bounds(self) -> tuple[Array, Array]:
        return span_of(self.position(np.linspace(0.0, 1.0, 65)))


def span_of(points: Array) -> tuple[Array, Array]:
    """Return the least and greatest of points (n, K) in each axis, shape (K,)."""
    low: Array = points.min(axis=0)
    high: Array = points.max(axis=0)
    return low, high


def _horner(coefficients: Array, s: Array) -> Array:
    x = np.asarray(s, dtype=float)[:, None]
    result: Array = np.broadcast_to(coefficients[-1], (len(x), coefficients.shape[1])).copy()
    for row in coefficients[-2::-1]:
        result = result * x + row
    return result


def _derivative(coefficients: Array) -> Array:
    powers = np.arange(1, len(coefficients))[:, None]
    result: Array = coefficients[1:] * powers
    return result
