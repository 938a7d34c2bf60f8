"""Quintic B-splines on knots of any spacing: basis functions, derivatives, Taylor coefficients of spans.

Source: Piegl and Tiller, The NURBS Book, chapter 2 (algorithms A2.2 and A2.3).
"""

from __future__ import annotations

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

DEGREE = 5
ORDER = DEGREE + 1


@compiled
def basis(knots: Array, span: int, t: float, values: Array) -> None:
    """Write the six basis functions that do not vanish on a span, shape (6,).

    Args:
        span: index of the knot that the span begins at; the functions are those of the control points
            ``span`` - 5 to ``span``.
    """
    left, right = np.empty(ORDER), np.empty(ORDER)
    values[0] = 1.0
    for j in range(1, ORDER):
        left[j] = t - knots[span + 1 - j]
        right[j] = knots[span + j] - t
        saved = 0.0
        for r in range(j):
            part = values[r] / (right[r + 1] + left[j - r])
            values[r] = saved + right[r + 1] * part
            saved = left[j - r] * part
        values[j] = saved


@compiled
def basis_derivatives(knots: Array, span: int, t: float, order: int, values: Array) -> None:
    """Write the basis functions of a span and their derivatives up to ``order``, shape (order + 1, 6)."""
    left, right = np.empty(ORDER), np.empty(ORDER)
    table, rows = np.empty((ORDER, ORDER)), np.empty((2, ORDER))
    table[0, 0] = 1.0
    for j in range(1, ORDER):
        left[j] = t - knots[span + 1 - j]
        right[j] = knots[span + j] - t
        saved = 0.0
        for r in range(j):
            table[j, r] = right[r + 1] + left[j - r]
            part = table[r, j - 1] / table[j, r]
            table[r, j] = saved + right[r + 1] * part
            saved = left[j - r] * part
        table[j, j] = saved
    for j in range(ORDER):
        values[0, j] = table[j, DEGREE]
    for r in range(ORDER):
        one, two = 0, 1
        rows[0, 0] = 1.0
        for k in range(1, order + 1):
            found = 0.0
            rk, pk = r - k, DEGREE - k
            if r >= k:
                rows[two, 0] = rows[one, 0] / table[pk + 1, rk]
                found = rows[two, 0] * table[rk, pk]
            first = 1 if rk >= -1 else -rk
            last = k - 1 if r - 1 <= pk else DEGREE - r
            for j in range(first, last + 1):
                rows[two, j] = (rows[one, j] - rows[one, j - 1]) / table[pk + 1, rk + j]
                found += rows[two, j] * table[rk + j, pk]
            if r <= pk:
                rows[two, k] = -rows[one, k - 1] / table[pk + 1, r]
                found += rows[two, k] * table[r, pk]
            values[k, r] = found
            one, two = two, one
    factor = float(DEGREE)
    for k in range(1, order + 1):
        for j in range(ORDER):
            values[k, j] *= factor
        factor *= DEGREE - k


@compiled
def taylor_of_spans(knots: Array, control: Array, spans: Array) -> None:
    """Write the polynomial of each span, coefficients of powers of (t - its start), constant first.

    Args:
        knots: clamped, shape (n + 6,). control: control points, shape (n, K).
        spans: shape (n - 5, 6, K).
    """
    values = np.empty((ORDER, ORDER))
    for index in range(len(spans)):
        span = index + DEGREE
        basis_derivatives(knots, span, knots[span], DEGREE, values)
        factor = 1.0
        for order in range(ORDER):
            if order > 1:
                factor *= order
            for k in range(control.shape[1]):
                total = 0.0
                for j in range(ORDER):
                    total += values[order, j] * control[index + j, k]
                spans[index, order, k] = total / factor
