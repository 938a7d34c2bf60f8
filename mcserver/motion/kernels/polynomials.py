"""Samples of polynomial curves, and the speed limit on samples."""

from __future__ import annotations

import math

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.sample_limits import CURVATURE_SHARE, JERK_SHARE, TINY

# Kinds of limits, by the number that `limit_of` returns.
KINDS = ("velocity", "acceleration", "jerk")


@compiled
def power_basis(points: Array, power: Array) -> None:
    """Write the coefficients, constant first, of the Bezier curve of six points; both of shape (6, K)."""
    for k in range(points.shape[1]):
        p0, p1, p2 = points[0, k], points[1, k], points[2, k]
        p3, p4, p5 = points[3, k], points[4, k], points[5, k]
        power[0, k] = p0
        power[1, k] = 5.0 * (p1 - p0)
        power[2, k] = 10.0 * (p2 - 2.0 * p1 + p0)
        power[3, k] = 10.0 * (p3 - 3.0 * p2 + 3.0 * p1 - p0)
        power[4, k] = 5.0 * (p4 - 4.0 * p3 + 6.0 * p2 - 4.0 * p1 + p0)
        power[5, k] = p5 - 5.0 * p4 + 10.0 * p3 - 10.0 * p2 + 5.0 * p1 - p0


@compiled
def restrict_polynomial(power: Array, low: float, span: float, part: Array) -> None:
    """Write the polynomial over [low, low + span] as one over [0, 1].

    Args:
        power, part: coefficients, shape (n, K), constant first.
    """
    degree = len(power) - 1
    for k in range(power.shape[1]):
        for i in range(degree + 1):
            part[i, k] = power[i, k]
        # Taylor shift by synthetic division
        for i in range(degree):
            for j in range(degree - 1, i - 1, -1):
                part[j, k] += low * part[j + 1, k]
        factor = 1.0
        for i in range(degree + 1):
            part[i, k] *= factor
            factor *= span


@compiled
def polynomial_samples(power: Array, scale: float, rows: Array, speeds: Array) -> None:
    """Write samples of a polynomial in σ = s·scale at evenly spaced s.

    Args:
        rows: shape (n, 5 K + 2), zeroed before; written.
        power: shape (m, K), constant first; a column that does not move is 0 but for the constant.
        speeds: shape (n,), written: |dp/ds|.
    """
    count, width = len(rows), power.shape[1]
    degree = len(power) - 1
    for i in range(count):
        s = i / (count - 1)
        square = 0.0
        for k in range(width):
            first = second = third = 0.0
            for row in range(degree, 0, -1):
                first = first * s + row * power[row, k]
            for row in range(degree, 1, -1):
                second = second * s + row * (row - 1) * power[row, k]
            for row in range(degree, 2, -1):
                third = third * s + row * (row - 1) * (row - 2) * power[row, k]
            square += first * first
            rows[i, k] = abs(first) / scale
            rows[i, width + k] = abs(second) / (scale * scale)
            rows[i, 2 * width + k] = abs(third) / (scale * scale * scale)
        rows[i, 5 * width] = math.inf
        rows[i, 5 * width + 1] = math.inf
        speeds[i] = math.sqrt(square)


@compiled
def limit_of(rows: Array, limits: Array) -> tuple[float, int, int]:
    """Return the greatest constant speed on samples without vertices, and column and kind of its limit."""
    width = limits.shape[1]
    best, column, kind = math.inf, 0, 0
    for k in range(width):
        dq = d2q = d3q = 0.0
        for i in range(len(rows)):
            dq = max(dq, rows[i, k])
            d2q = max(d2q, rows[i, width + k])
            d3q = max(d3q, rows[i, 2 * width + k])
        by_velocity = limits[0, k] / max(dq, TINY)
        if by_velocity < best:
            best, column, kind = by_velocity, k, 0
        if d2q > 0.0:
            by_d2q = math.sqrt(CURVATURE_SHARE * limits[1, k] / d2q)
            if by_d2q < best:
                best, column, kind = by_d2q, k, 1
        if d3q > 0.0:
            by_d3q = (JERK_SHARE * limits[2, k] / d3q) ** (1.0 / 3.0)
            if by_d3q < best:
                best, column, kind = by_d3q, k, 2
    return best, column, kind
