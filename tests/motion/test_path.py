"""Curves p(s): derivatives, ends and bounds, held against differences and dense sampling."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from mcserver.motion.geometry.curves import Array, Curve, LineCurve, PolynomialCurve, SampledCurve
from tests.motion.support import arc_curve
from tests.motion.test_laws import law

COORDINATES = st.sampled_from([0.0, 1.0, -0.3, 1e-3, 0.0471])


@st.composite
def lines(draw: st.DrawFn) -> Curve:
    axes = tuple(range(draw(st.integers(1, 4))))
    start = tuple(draw(COORDINATES) for _ in axes)
    return LineCurve(axes, start, tuple(draw(COORDINATES) for _ in axes))


@st.composite
def arcs(draw: st.DrawFn, growing: bool = True) -> Curve:
    radius = draw(st.sampled_from([1e-3, 0.05, 1.0]))
    angle = draw(st.floats(-math.pi, math.pi))
    sweep = draw(st.sampled_from([1, -1])) * draw(st.floats(1e-3, 15.0))
    start = [draw(COORDINATES), draw(COORDINATES)]
    further = draw(st.lists(COORDINATES, max_size=2))
    return arc_curve(
        [*start, *[0.1] * len(further)],
        (start[0] + radius * math.cos(angle), start[1] + radius * math.sin(angle)),
        sweep,
        axes=tuple(range(2 + len(further))),
        further=further,
        growth=draw(st.sampled_from([0.0, 5e-6, -1e-3 * radius])) if growing else 0.0,
    )


@st.composite
def splines(draw: st.DrawFn) -> Curve:
    knots = np.linspace(0.0, 1.0, draw(st.integers(2, 9)))
    values = np.array([[draw(COORDINATES) for _ in range(3)] for _ in knots])
    return SampledCurve((0, 1, 2), knots, CubicSpline(knots, values).c, 1.0)


@st.composite
def polynomials(draw: st.DrawFn) -> Curve:
    return PolynomialCurve((0, 1), np.array([[draw(COORDINATES), draw(COORDINATES)] for _ in range(6)]), 1.0)


ANY = st.one_of(lines(), arcs(), splines(), polynomials())


@given(ANY)
@law(100)
def test_derivatives_are_those_of_the_position(curve: Curve) -> None:
    s = np.linspace(0.05, 0.95, 41) + 1e-4
    h = 1e-5
    size = 1.0 + max(np.abs(part).max() for part in curve.derivatives(s))
    first, second, third = curve.derivatives(s)
    assert _difference(curve.position, s, h) == pytest.approx(first, abs=1e-5 * size)
    assert _difference(lambda x: curve.derivatives(x)[0], s, h) == pytest.approx(second, abs=1e-5 * size)
    if not isinstance(curve, SampledCurve):
        assert _difference(lambda x: curve.derivatives(x)[1], s, h) == pytest.approx(third, abs=1e-5 * size)


def _difference(function: object, s: Array, h: float) -> Array:
    result: Array = (function(s + h) - function(s - h)) / (2.0 * h)  # type: ignore[operator]
    return result


@given(ANY)
@law(100)
def test_bounds_hold_every_point_and_are_no_wider_than_a_spiral_asks(curve: Curve) -> None:
    low, high = curve.bounds()
    points = curve.position(np.linspace(0.0, 1.0, 20_001))
    size = 1e-9 + float((points.max(axis=0) - points.min(axis=0)).max())
    # splines and polynomials are bounded by samples of their own
    slack = 1e-12 if isinstance(curve, LineCurve) or hasattr(curve, "sweep") else 2e-3 * size
    assert (points.min(axis=0) >= low - slack).all()
    assert (points.max(axis=0) <= high + slack).all()
    growth = abs(getattr(curve, "end_radius", 0.0) - getattr(curve, "start_radius", 0.0))
    assert (low >= points.min(axis=0) - growth - 1e-6 * size).all()
    assert (high <= points.max(axis=0) + growth + 1e-6 * size).all()


@given(st.one_of(lines(), arcs()))
@law(60)
def test_programmed_ends_are_exact(curve: Curve) -> None:
    ends = curve.position(np.array([0.0, 1.0]))
    assert ends[0].tolist() == list(curve.start)  # type: ignore[attr-defined]
    assert ends[1].tolist() == list(curve.end)  # type: ignore[attr-defined]


@given(arcs(growing=False))
@law(60)
def test_an_arc_keeps_its_radius_and_turns_in_proportion_to_s(curve: Curve) -> None:
    s = np.linspace(0.0, 1.0, 1001)
    offset = curve.position(s)[:, :2] - curve.centre  # type: ignore[attr-defined]
    radius = np.hypot(offset[:, 0], offset[:, 1])
    assert radius == pytest.approx(curve.start_radius, rel=1e-9)  # type: ignore[attr-defined]
    turned = np.unwrap(np.arctan2(offset[:, 1], offset[:, 0]))
    assert turned - turned[0] == pytest.approx(curve.sweep * s, abs=1e-6)  # type: ignore[attr-defined]
