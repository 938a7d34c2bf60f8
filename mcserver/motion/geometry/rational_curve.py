"""Polynomial and rational Bezier curves parametrized by their arc length: the pieces of G5 and of NURBS.

Source of the derivatives of a quotient: Piegl and Tiller, The NURBS Book, eq. 4.8.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array, Curve, span_of

# cells of the parameter t over which the length is integrated
_CELLS = 128
# Gauss-Legendre quadrature in each of them
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_NEWTON_STEPS = 4
# samples for the tightest bend and for the bounds
_FINE = 2049
# cells of s per radius of the tightest bend, as many as an arc has samples
_CELLS_A_RADIUS = 20.0
_LEAST_CELLS, _MOST_CELLS = 128, 4096
# a cusp: |dp/dt| below this share of the mean
_STANDING = 1e-3


class Cusp(Exception):
    """dp/dt vanishes somewhere, or the curve bends too tightly for its limits to be sampled.

    Attributes:
        radius: of its tightest bend [m].
    """

    def __init__(self, radius: float) -> None:
        super().__init__(f"a bend of {radius} m")
        self.radius = radius


class RationalCurve(Curve, frozen=True, eq=False):
    """A polynomial or rational curve of a parameter t from 0 to 1, whose s is the share of its length.

    Attributes:
        axes: K axis numbers. numerators: coefficients of powers of t, constant first, with the denominator as
            the last column, shape (n+1, K+1).
        start, end: shape (K,), exact. length: [m].
        cells: t(s) as quintics between evenly spaced s, constant first, shape (m, 6). They approximate the
            arc length to a few last bits; positions are on the curve exactly.
    """

    numerators: Array
    start: tuple[float, ...]
    end: tuple[float, ...]
    cells: Array
    length: float

    @property
    def roundable(self) -> bool:
        return True

    def position(self, s: Array) -> Array:
        share = np.asarray(s, dtype=np.float64)
        points = by_parameter(self.numerators, self._parameter(share)[0])[0]
        points[share <= 0.0] = self.start
        points[share >= 1.0] = self.end
        return points

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        t, t1, t2, t3 = self._parameter(np.asarray(s, dtype=np.float64))
        _, c1, c2, c3 = by_parameter(self.numerators, t)
        t1, t2, t3 = t1[:, None], t2[:, None], t3[:, None]
        return c1 * t1, c2 * t1**2 + c1 * t2, c3 * t1**3 + 3.0 * c2 * t1 * t2 + c1 * t3

    def samples(self) -> Array:
        return np.linspace(0.0, 1.0, len(self.cells) + 1)

    def bounds(self) -> tuple[Array, Array]:
        points = by_parameter(self.numerators, np.linspace(0.0, 1.0, _FINE))[0]
        return span_of(np.vstack((points, self.start, self.end)))

    def ends(self) -> Array:
        return np.array((self.start, self.end))

    def _parameter(self, s: Array) -> tuple[Array, Array, Array, Array]:
        """Return t and its three derivatives by s, shape (len(s),) each."""
        count = len(self.cells)
        scaled = np.clip(s, 0.0, 1.0) * count
        cell = np.minimum(scaled.astype(np.intp), count - 1)
        x = scaled - cell
        k0, k1, k2, k3, k4, k5 = self.cells[cell].T
        t = ((((k5 * x + k4) * x + k3) * x + k2) * x + k1) * x + k0
        t1 = (((5.0 * k5 * x + 4.0 * k4) * x + 3.0 * k3) * x + 2.0 * k2) * x + k1
        t2 = ((20.0 * k5 * x + 12.0 * k4) * x + 6.0 * k3) * x + 2.0 * k2
        t3 = (60.0 * k5 * x + 24.0 * k4) * x + 6.0 * k3
        return t, t1 * count, t2 * count**2, t3 * count**3


def rational_curve(axes: tuple[int, ...], points: Array, weights: Array | None = None) -> RationalCurve:
    """Return the curve of control points (n+1, K) [m] with weights above 0, shape (n+1,); None: all are 1.

    Raises:
        Cusp: dp/dt vanishes somewhere, or a bend is too tight for the curve's length.
    """
    degree = len(points) - 1
    own = np.ones((degree + 1, 1)) if weights is None else np.asarray(weights, dtype=np.float64)[:, None]
    numerators = _bernstein_to_power(degree) @ np.hstack((points * own, own))
    edges = np.linspace(0.0, 1.0, _CELLS + 1)
    lengths = np.concatenate(([0.0], np.cumsum(_length_between(numerators, edges[:-1], edges[1:]))))
    length = float(lengths[-1])
    _, first, second, _ = by_parameter(numerators, np.linspace(0.0, 1.0, _FINE))
    speed = np.linalg.norm(first, axis=1)
    if not speed.min() > _STANDING * length:
        raise Cusp(0.0)
    along = first / speed[:, None]
    across = second - (second * along).sum(axis=1)[:, None] * along
    bend = float((np.linalg.norm(across, axis=1) / speed**2).max())
    count = max(_LEAST_CELLS, math.ceil(_CELLS_A_RADIUS * bend * length))
    if count > _MOST_CELLS:
        raise Cusp(1.0 / bend)
    cells = _quintics(numerators, lengths, count)
    start, end = (tuple(each.tolist()) for each in (points[0], points[-1]))
    return RationalCurve(axes, numerators, start, end, cells, length)


def _quintics(numerators: Array, lengths: Array, count: int) -> Array:
    """Return t(s) in evenly spaced cells, exact up to the second derivative at their edges, (count, 6)."""
    passed = np.linspace(0.0, float(lengths[-1]), count + 1)
    cell = np.clip(np.searchsorted(lengths, passed, side="right") - 1, 0, _CELLS - 1)
    low, beyond = cell / _CELLS, passed - lengths[cell]
    t: Array = low + beyond / (lengths[cell + 1] - lengths[cell]) / _CELLS
    for _ in range(_NEWTON_STEPS):
        step = (beyond - _length_between(numerators, low, t)) / _speeds(numerators, t)
        t = np.clip(t + step, low, low + 1.0 / _CELLS)
    t[-1] = 1.0
    _, first, second, _ = by_parameter(numerators, t)
    speed = np.linalg.norm(first, axis=1)
    # dt/ds = length / |dc/dt|, in units of a cell
    a = float(lengths[-1]) / speed / count
    b = -a * a * (first * second).sum(axis=1) / speed**2
    rise, a0, a1, b0, b1 = np.diff(t), a[:-1], a[1:], b[:-1], b[1:]
    return np.stack(
        (
            t[:-1],
            a0,
            0.5 * b0,
            10.0 * rise - 6.0 * a0 - 4.0 * a1 - 1.5 * b0 + 0.5 * b1,
            -15.0 * rise + 8.0 * a0 + 7.0 * a1 + 1.5 * b0 - b1,
            6.0 * rise - 3.0 * (a0 + a1) - 0.5 * (b0 - b1),
        ),
        axis=1,
    )


def by_parameter(numerators: Array, t: Array) -> tuple[Array, Array, Array, Array]:
    """Return positions and three derivatives by t, each of shape (len(t), K)."""
    found = _powers(numerators, t, 4)
    a, a1, a2, a3 = (each[:, :-1] for each in found)
    w, w1, w2, w3 = (each[:, -1:] for each in found)
    place = a / w
    first = (a1 - w1 * place) / w
    second = (a2 - 2.0 * w1 * first - w2 * place) / w
    return place, first, second, (a3 - 3.0 * w1 * second - 3.0 * w2 * first - w3 * place) / w


def _powers(numerators: Array, t: Array, count: int) -> list[Array]:
    """Return a polynomial and its derivatives, ``count`` in all, each of shape (len(t), K+1)."""
    found: list[Array] = []
    for _ in range(count):
        value: Array = np.zeros((len(t), numerators.shape[1]))
        for row in numerators[::-1]:
            value = value * t[:, None] + row
        found.append(value)
        numerators = numerators[1:] * np.arange(1, len(numerators))[:, None]
    return found


def _speeds(numerators: Array, t: Array) -> Array:
    """Return |dp/dt|, shape (len(t),) [m]."""
    place, first = _powers(numerators, t, 2)
    w = place[:, -1:]
    rates = (first[:, :-1] - first[:, -1:] * place[:, :-1] / w) / w
    speeds: Array = np.linalg.norm(rates, axis=1)
    return speeds


def _length_between(numerators: Array, low: Array, high: Array) -> Array:
    """Return the lengths between parameters, shape (n,) [m]."""
    half = (high - low)[:, None] / 2.0
    places = (low + high)[:, None] / 2.0 + half * _NODES
    speeds = _speeds(numerators, places.ravel()).reshape(places.shape)
    lengths: Array = half[:, 0] * (speeds @ _WEIGHTS)
    return lengths


def _bernstein_to_power(degree: int) -> NDArray[np.float64]:
    """Return the matrix from control points to coefficients of powers of t, shape (degree+1, degree+1)."""
    matrix = np.zeros((degree + 1, degree + 1))
    for row in range(degree + 1):
        for column in range(row + 1):
            sign = -1.0 if (row - column) % 2 else 1.0
            matrix[row, column] = sign * math.comb(degree, row) * math.comb(row, column)
    return matrix
