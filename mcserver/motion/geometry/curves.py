"""Exact curves p(s) over axes, s in [0, 1]: lines, arcs, helices, and joint paths of tools.

A curve knows which axes it moves and gives position and the first three derivatives with respect to s at
any s. Curves are never approximated by chords, only sampled at the cycle. All quantities are SI (m, rad).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.units import TURN

Array = NDArray[np.float64]
# Jacobian of a tool: positions of axes, shape (n, K) → shape (n, 3 or 6, K), rows for its tip [m] and its
# rotation [rad].
ToolRates = Callable[[Array], Array]

# Samples of a curve of unknown shape, and of a whole turn of an arc: 128 points miss an extreme by 0.03 %.
TURN_SAMPLES = 129
# Samples of a polynomial.
POLYNOMIAL_SAMPLES = 33
_ENDS = np.array([0.0, 1.0])


class Curve(msgspec.Struct, frozen=True):
    """A path over ``axes`` (axis numbers, in the order of the columns), K of them.

    Attributes:
        straight: whether dp/ds is constant.
    """

    straight: ClassVar[bool] = False

    axes: tuple[int, ...]

    @property
    def roundable(self) -> bool:
        """Whether the corners at its ends may be rounded."""
        return False

    @property
    def tool_rates(self) -> ToolRates | None:
        """Jacobian of the tool that it moves; None: no tool, or one whose corners are not rounded."""
        return None

    @property
    def length(self) -> float:
        """Length of the programmed path (D-30): m for linear axes and tools, rad for rotary ones."""
        return 0.0

    @property
    def max_path_rate(self) -> float:
        """Greatest derivative of the path's length by s [m or rad]."""
        return self.length

    @property
    def lever(self) -> float:
        """Greatest travel of a tool's tip by that of its joints, as the path tolerance measures both [1]."""
        return 1.0

    def position(self, s: Array) -> Array:
        """Positions, shape (len(s), K) [m or rad]."""
        raise NotImplementedError

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        """dp/ds, d²p/ds², d³p/ds³, each of shape (len(s), K)."""
        raise NotImplementedError

    def samples(self) -> Array:
        """Values of s at which the axes' limits are evaluated, evenly spaced from 0."""
        return np.linspace(0.0, 1.0, TURN_SAMPLES)

    def bounds(self) -> tuple[Array, Array]:
        """Return the least and greatest position of each axis on the whole curve, shape (K,) each."""
        return span_of(self.position(self.samples()))

    def ends(self) -> Array:
        """Positions at s = 0 and 1, shape (2, K)."""
        return self.position(_ENDS)

    @property
    def arc(self) -> Array | None:
        """Row of an arc for `mcserver.motion.kernels.arc_segments`, without its columns; None: no arc."""
        return None

    @property
    def power(self) -> Array | None:
        """Coefficients of a polynomial in s, shape (n+1, K), constant first; None: not a polynomial."""
        return None


class LineCurve(Curve, frozen=True):
    """A straight line in joint space; an axis that is named but does not travel stays in ``axes``.

    ``length`` depends on the axes' types (D-30), so the caller gives it; it does not affect the shape.
    """

    straight: ClassVar[bool] = True

    start: tuple[float, ...]
    end: tuple[float, ...]
    length: float = 0.0

    @property
    def roundable(self) -> bool:
        return True

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

    def samples(self) -> Array:
        return _ENDS

    def ends(self) -> Array:
        return np.array((self.start, self.end))


class TipLine(LineCurve, frozen=True):
    """A line in joint space short enough that the tool's tip stays near the programmed straight line.

    Attributes:
        length: of the tip's path [m]. max_path_rate: greatest derivative of the tip's path by s [m].
        tool_rates: Jacobian of the tip, at positions of ``axes``.
        lever: as of `Curve`.
    """

    tool_rates: ToolRates | None = None
    max_path_rate: float = 0.0
    lever: float = 1.0


class TipColumns(msgspec.Struct, frozen=True, eq=False):
    """What n consecutive lines have as `TipLine` besides.

    Attributes:
        tool_rates: of all of them. fastest: `max_path_rate`, shape (n,) [m]. levers: shape (n,).
    """

    tool_rates: ToolRates
    fastest: Array
    levers: Array

    def __len__(self) -> int:
        return len(self.fastest)

    @classmethod
    def joined(cls, tool_rates: ToolRates, parts: Sequence[TipColumns]) -> TipColumns:
        """Return consecutive parts as one."""
        fastest, levers = (
            np.concatenate([np.empty(0), *(getattr(part, name) for part in parts)])
            for name in ("fastest", "levers")
        )
        return cls(tool_rates, fastest, levers)

    def part(self, at: slice) -> TipColumns:
        """Return some of the lines."""
        return TipColumns(self.tool_rates, self.fastest[at], self.levers[at])

    def line(
        self,
        index: int,
        axes: tuple[int, ...],
        ends: tuple[tuple[float, ...], tuple[float, ...]],
        length: float,
    ) -> TipLine:
        """Return one of the lines, of joints ``axes`` between its ends."""
        fastest, lever = float(self.fastest[index]), float(self.levers[index])
        return TipLine(axes, *ends, length, self.tool_rates, fastest, lever)


class ArcCurve(Curve, frozen=True):
    """A circular arc, helix or spiral of D-22.

    The first two of ``axes`` are the plane's axes (first, second) in right-handed order seen from the
    plane's positive normal: (X, Y) for G17, (Z, X) for G18, (Y, Z) for G19. Further axes and the radius
    change linearly with the angle.

    Attributes:
        start, end: shape (len(axes),), positions at s = 0 and s = 1; the plane's axes come first.
        centre: (first, second) of the centre.
        sweep: total angle with all turns [rad]; positive is counter-clockwise (G03).
        length: arc length in the plane, or helix length with the further axes [m].
    """

    start: tuple[float, ...]
    end: tuple[float, ...]
    centre: tuple[float, float]
    sweep: float
    length: float

    @property
    def roundable(self) -> bool:
        return True

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

    @property
    def max_path_rate(self) -> float:
        radius = self.start_radius
        known = (self.length, self.sweep, radius, self.end_radius - radius)
        return float(max_path_rates(*(np.array(value) for value in known)))

    def samples(self) -> Array:
        count = int(samples_of_arcs(np.array(self.sweep)))
        return np.linspace(0.0, min(1.0, TURN / max(abs(self.sweep), TURN)), count)

    def ends(self) -> Array:
        return np.array((self.start, self.end))

    @property
    def arc(self) -> Array:
        radius = self.start_radius
        growth = self.end_radius - radius
        count = float(samples_of_arcs(np.array(self.sweep)))
        return np.array([*self.centre, self.start_angle, self.sweep, radius, growth, count])

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


class SampledCurve(Curve, frozen=True):
    """A joint path as a cubic spline over knots of s, from inverse kinematics along a tool's path.

    Attributes:
        axes: K axis numbers.
        knots: shape (M,), increasing from 0 to 1.
        coefficients: shape (4, M-1, K), highest power first, in (s - knots[i]) (as scipy's PPoly).
        length: of the tool's path [m], or the angle of a pure rotation [rad].
    """

    knots: Array
    coefficients: Array
    length: float
    tool_rates: ToolRates | None = None

    @property
    def roundable(self) -> bool:
        return self.tool_rates is not None

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

    def samples(self) -> Array:
        return np.linspace(0.0, 1.0, 4 * (len(self.knots) - 1) + 1)

    def bounds(self) -> tuple[Array, Array]:
        fine = np.unique(np.concatenate([np.linspace(0.0, 1.0, 257), self.knots]))
        return span_of(self.position(fine))


class PolynomialCurve(Curve, frozen=True):
    """A polynomial of degree n in s, such as a corner blend.

    Attributes:
        axes: K axis numbers.
        coefficients: shape (n+1, K), constant term first [m or rad].
        length: measured along the curve [m or rad].
    """

    coefficients: Array
    length: float

    def position(self, s: Array) -> Array:
        return _horner(self.coefficients, s)

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        first = _derivative(self.coefficients)
        second = _derivative(first)
        return _horner(first, s), _horner(second, s), _horner(_derivative(second), s)

    @property
    def power(self) -> Array:
        return self.coefficients

    def samples(self) -> Array:
        return np.linspace(0.0, 1.0, POLYNOMIAL_SAMPLES)

    def bounds(self) -> tuple[Array, Array]:
        return span_of(self.position(np.linspace(0.0, 1.0, 65)))


def span_of(points: Array) -> tuple[Array, Array]:
    """Return the least and greatest of points (n, K) in each axis, shape (K,)."""
    low: Array = points.min(axis=0)
    high: Array = points.max(axis=0)
    return low, high


def samples_of_arcs(sweeps: Array) -> Array:
    """Return the numbers of samples at which the limits of arcs are evaluated, shape (n,).

    Derivatives of a circle repeat after one turn.
    """
    share: Array = np.minimum(np.abs(sweeps), TURN) / TURN
    return np.minimum(float(TURN_SAMPLES), 3.0 + np.floor(128.0 * share))


def max_path_rates(lengths: Array, sweeps: Array, radii: Array, growths: Array) -> Array:
    """Return `Curve.max_path_rate` of arcs, shape (n,) [m]: with a change of radius more than the length.

    Args:
        lengths, sweeps: as in `ArcCurve`. radii, growths: radii at the start, and their changes to the end.
    """
    widest = np.abs(growths) * (radii + 0.5 * growths) + 0.25 * growths * growths
    rates: Array = np.sqrt(lengths * lengths + sweeps * sweeps * widest)
    return rates


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
