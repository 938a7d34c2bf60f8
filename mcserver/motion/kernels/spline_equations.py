"""Equations of a smoothing quintic B-spline along a polyline.

It minimizes Σ w |q(t) - r|² + ∫ L(t)⁶ |q'''(t)|² dt over the control points, where r are targets at samples
of the polyline and w the lengths that these represent. The equations are banded and symmetric.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.spline_basis import DEGREE, ORDER, basis, basis_derivatives

# Greatest |dL/dt|.
GRADE = 0.3
# Three-point Gauss-Legendre quadrature, exact for the square of a third derivative.
_PLACES = (0.5 - 0.5 * math.sqrt(0.6), 0.5, 0.5 + 0.5 * math.sqrt(0.6))
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


class Samples(NamedTuple):
    """S samples of the polyline.

    Attributes:
        firsts: the first control point that each depends on, shape (S,). values: of the basis functions from
            that one on, shape (S, 6). weights: lengths that they represent, shape (S,). places: shape (S, K).
        limits: greatest distance of the curve from them, shape (S,).
    """

    firsts: NDArray[np.intp]
    values: Array
    weights: Array
    places: Array
    limits: Array


class Equations(NamedTuple):
    """The factored equations of n control points, for any targets.

    Attributes:
        solvable: whether they can be solved.
        factors: LDLᵀ of the matrix, the upper half of its band, shape (n, 6). offset: terms of the known
            control points on the right-hand sides, shape (n, K). known: these points, shape (n, K).
        fixed: number of known points at each end.
    """

    solvable: bool
    factors: Array
    offset: Array
    known: Array
    fixed: tuple[int, int]


@compiled
def reach_at(t: Array, reach: Array, chord: int, place: float, longest: float) -> float:
    """Return L at a place of a chord."""
    before = reach[chord] + GRADE * (place - t[chord])
    after = reach[chord + 1] + GRADE * (t[chord + 1] - place)
    reached: float = min(before, after, longest)
    return reached


@compiled
def bind_end(knots: Array, control: Array, jet: Array, conditions: int, first: bool) -> None:
    """Write the control points at an end for a given position and derivatives there.

    Args:
        jet: position and three derivatives, shape (4, K).
    """
    n, width = control.shape
    values = np.empty((4, ORDER))
    span = DEGREE if first else n - 1
    basis_derivatives(knots, span, knots[0] if first else knots[-1], 3, values)
    for order in range(conditions):
        for k in range(width):
            total = jet[order, k]
            for j in range(order):
                at, value = (j, values[order, j]) if first else (n - 1 - j, values[order, DEGREE - j])
                total -= value * control[at, k]
            if first:
                control[order, k] = total / values[order, order]
            else:
                control[n - 1 - order, k] = total / values[order, DEGREE - order]


@compiled
def sample(t: Array, points: Array, limits: Array, counts: NDArray[np.intp], knots: Array) -> Samples:
    """Sample the polyline.

    Args:
        limits: greatest distance of the curve from the chords, shape (n,). counts: steps on each, shape (n,).
    """
    width, size = points.shape[1], counts.sum() + len(counts)
    firsts, weights, within = np.empty(size, np.intp), np.empty(size), np.empty(size)
    values, places = np.empty((size, ORDER)), np.empty((size, width))
    span, last = DEGREE, len(knots) - ORDER - 1
    at = 0
    for chord in range(len(counts)):
        low, length, count = t[chord], t[chord + 1] - t[chord], counts[chord]
        for i in range(count + 1):
            share = i / count
            place = low + share * length
            while span < last and knots[span + 1] <= place:
                span += 1
            while span > DEGREE and knots[span] > place:
                span -= 1
            basis(knots, span, place, values[at])
            firsts[at] = span - DEGREE
            weights[at] = length / count * (0.5 if i in (0, count) else 1.0)
            within[at] = limits[chord]
            for k in range(width):
                places[at, k] = points[chord, k] + share * (points[chord + 1, k] - points[chord, k])
            at += 1
    return Samples(firsts, values, weights, places, within)


@compiled
def _matrix(t: Array, reach: Array, longest: float, knots: Array, samples: Samples, band: Array) -> None:
    """Add up the upper half of the symmetric matrix of the normal equations, shape (n, 6), zeroed."""
    for at in range(len(samples.firsts)):
        first, values = samples.firsts[at], samples.values[at]
        for a in range(ORDER):
            part = samples.weights[at] * values[a]
            for b in range(a, ORDER):
                band[first + a, b - a] += part * values[b]
    derivatives = np.empty((4, ORDER))
    chord = 0
    for span in range(DEGREE, len(knots) - ORDER):
        low, length = knots[span], knots[span + 1] - knots[span]
        first = span - DEGREE
        middle = low + 0.5 * length
        while chord < len(t) - 2 and t[chord + 1] <= middle:
            chord += 1
        stiffness = reach_at(t, reach, chord, middle, longest) ** 6
        for which in range(len(_PLACES)):
            basis_derivatives(knots, span, low + _PLACES[which] * length, 3, derivatives)
            for a in range(ORDER):
                part = stiffness * _WEIGHTS[which] * length * derivatives[3, a]
                for b in range(a, ORDER):
                    band[first + a, b - a] += part * derivatives[3, b]


@compiled
def _fix(band: Array, offset: Array, control: Array, index: int) -> None:
    """Eliminate a known control point from the equations.

    Args:
        offset: terms of known points on the right-hand sides, shape (n, K), written.
    """
    n, width = control.shape
    for d in range(1, ORDER):
        if index + d < n:
            for k in range(width):
                offset[index + d, k] -= band[index, d] * control[index, k]
        band[index, d] = 0.0
        if index - d >= 0:
            for k in range(width):
                offset[index - d, k] -= band[index - d, d] * control[index, k]
            band[index - d, d] = 0.0
    band[index, 0] = 1.0


@compiled
def _factor(band: Array) -> bool:
    """Factor a banded matrix as LDLᵀ in place, the factors of L unscaled; False where it is singular."""
    n = len(band)
    for i in range(n):
        pivot = band[i, 0]
        if not pivot > 0.0:
            return False
        for d in range(1, min(ORDER, n - i)):
            factor = band[i, d] / pivot
            for e in range(d, min(ORDER, n - i)):
                band[i + d, e - d] -= factor * band[i, e]
    return True


@compiled
def _substitute(band: Array, right: Array) -> None:
    """Solve factored equations in place."""
    n, width = right.shape
    for i in range(n):
        for d in range(1, min(ORDER, n - i)):
            factor = band[i, d] / band[i, 0]
            for k in range(width):
                right[i + d, k] -= factor * right[i, k]
    for i in range(n - 1, -1, -1):
        for k in range(width):
            total = right[i, k]
            for d in range(1, min(ORDER, n - i)):
                total -= band[i, d] * right[i + d, k]
            right[i, k] = total / band[i, 0]


@compiled
def equations(
    t: Array,
    reach: Array,
    longest: float,
    knots: Array,
    samples: Samples,
    known: Array,
    fixed: tuple[int, int],
) -> Equations:
    """Return the equations of a curve.

    Args:
        t: the polyline's vertices, shape (m+1,). reach, longest: L at them, and the longest.
        known, fixed: see `Equations`.
    """
    n = len(known)
    band, offset = np.zeros((n, ORDER)), np.zeros(known.shape)
    _matrix(t, reach, longest, knots, samples, band)
    for index in range(fixed[0]):
        _fix(band, offset, known, index)
    for index in range(fixed[1]):
        _fix(band, offset, known, n - 1 - index)
    return Equations(_factor(band), band, offset, known, fixed)


@compiled
def solve(equations: Equations, samples: Samples, targets: Array) -> Array:
    """Return the control points, shape (n, K), for targets at the samples, shape (S, K)."""
    right, known, fixed = equations.offset.copy(), equations.known, equations.fixed
    n, width = right.shape
    for at in range(len(targets)):
        first = samples.firsts[at]
        for a in range(ORDER):
            part = samples.weights[at] * samples.values[at, a]
            for k in range(width):
                right[first + a, k] += part * targets[at, k]
    right[: fixed[0]] = known[: fixed[0]]
    right[n - fixed[1] :] = known[n - fixed[1] :]
    _substitute(equations.factors, right)
    return right
