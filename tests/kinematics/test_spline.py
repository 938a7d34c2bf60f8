"""The spline's bounds, against its values."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from mckinematics.spline import clamped_spline, evaluate_cells, spline_extremes, spline_hull


def _spline(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    knots = np.concatenate([[0.0], np.cumsum(random.uniform(0.05, 1.0, count))])
    values = random.uniform(-2.0, 2.0, (count + 1, 3))
    return knots, clamped_spline(knots, values, *random.uniform(-5.0, 5.0, (2, 3)))


@given(st.integers(0, 10_000), st.integers(1, 8))
def test_no_value_is_beyond_the_extremes_and_no_extreme_beyond_the_hull(seed: int, count: int) -> None:
    knots, coefficients = _spline(seed, count)
    values = evaluate_cells(knots, coefficients, np.linspace(0.0, 1.0, 101))[1]
    low, high = spline_extremes(knots, coefficients)
    assert (values.min(axis=1) >= low - 1e-12).all()
    assert (values.max(axis=1) <= high + 1e-12).all()
    below, above = spline_hull(knots, coefficients)
    assert (below <= low.min(axis=0) + 1e-12).all()
    assert (above >= high.max(axis=0) - 1e-12).all()


@given(st.integers(0, 10_000), st.integers(1, 8))
def test_the_extremes_are_reached(seed: int, count: int) -> None:
    knots, coefficients = _spline(seed, count)
    values = evaluate_cells(knots, coefficients, np.linspace(0.0, 1.0, 2001))[1]
    low, high = spline_extremes(knots, coefficients)
    np.testing.assert_allclose(values.min(axis=1), low, atol=1e-4)
    np.testing.assert_allclose(values.max(axis=1), high, atol=1e-4)
