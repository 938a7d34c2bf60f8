"""Clamped cubic splines: twice continuously differentiable, with given slopes at both ends."""

from __future__ import annotations

import numpy as np

from mckinematics.pose import Array


def clamped_spline(knots: Array, values: Array, start_slope: Array, end_slope: Array) -> Array:
    """Coefficients of the cubic spline through ``values`` with these end slopes (de Boor, ch. IV).

    Args:
        knots: shape (M,), increasing. values: shape (M, K). start_slope, end_slope: shape (K,).

    Returns:
        Shape (4, M-1, K), highest power first, in (s - knots[i]).
    """
    # here, so that machines without tools need no SciPy
    from scipy.linalg.lapack import dgtsv

    width = np.diff(knots)
    secant = np.diff(values, axis=0) / width[:, None]
    slopes = np.empty_like(values)
    slopes[0], slopes[-1] = start_slope, end_slope
    if len(knots) > 2:
        before, after = width[:-1], width[1:]
        right = 3.0 * (after[:, None] * secant[:-1] + before[:, None] * secant[1:])
        right[0] -= after[0] * slopes[0]
        right[-1] -= before[-1] * slopes[-1]
        diagonal = 2.0 * (before + after)
        # LAPACK's wrapper takes no matrix of one row
        alone = len(diagonal) == 1
        slopes[1:-1] = right / diagonal[0] if alone else dgtsv(after[1:], diagonal, before[:-1], right)[3]
    coefficients = np.empty((4, len(width), values.shape[1]))
    coefficients[0] = (slopes[:-1] + slopes[1:] - 2.0 * secant) / width[:, None] ** 2
    coefficients[1] = (3.0 * secant - 2.0 * slopes[:-1] - slopes[1:]) / width[:, None]
    coefficients[2] = slopes[:-1]
    coefficients[3] = values[:-1]
    return coefficients


def evaluate_cells(knots: Array, coefficients: Array, shares: Array) -> tuple[Array, Array]:
    """Return the spline at the same shares (0 … 1) of each cell.

    Returns:
        s of shape (M-1, F) and values of shape (M-1, F, K) for F shares.
    """
    offsets = np.diff(knots)[:, None] * shares
    x = offsets[..., None]
    c3, c2, c1, c0 = coefficients[:, :, None, :]
    return knots[:-1, None] + offsets, ((c3 * x + c2) * x + c1) * x + c0


def spline_hull(knots: Array, coefficients: Array) -> tuple[Array, Array]:
    """Bounds of each column, shape (K,) each: no value of the spline is beyond them.

    Each cell lies in the convex hull of its Bernstein coefficients (de Boor).
    """
    width = np.diff(knots)[:, None]
    c3, c2, c1, c0 = coefficients
    third = c1 * width / 3.0
    bend = c2 * (width * width) / 3.0
    points = np.stack([c0, c0 + third, c0 + 2.0 * third + bend, c0 + 3.0 * (third + bend) + c3 * width**3])
    return points.min(axis=(0, 1)), points.max(axis=(0, 1))


def spline_extremes(knots: Array, coefficients: Array) -> tuple[Array, Array]:
    """Least and greatest value of each cell and column, exact: shapes (M-1, K) each."""
    width = np.diff(knots)[:, None]
    c3, c2, c1, c0 = coefficients
    end = ((c3 * width + c2) * width + c1) * width + c0
    low, high = np.minimum(c0, end), np.maximum(c0, end)
    # 3·c3·x² + 2·c2·x + c1 = 0, in the form that does not cancel
    root = np.sqrt(np.maximum(c2 * c2 - 3.0 * c3 * c1, 0.0))
    half = -(c2 + np.where(c2 >= 0.0, root, -root))
    for top, bottom in ((half, 3.0 * c3), (c1, half)):
        nonzero = np.abs(bottom) > 1e-300
        x = np.where(nonzero, top / np.where(nonzero, bottom, 1.0), 0.0)
        x = np.clip(np.nan_to_num(x), 0.0, width)
        value = ((c3 * x + c2) * x + c1) * x + c0
        low, high = np.minimum(low, value), np.maximum(high, value)
    return low, high
