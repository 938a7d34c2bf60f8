"""Samples of a curve's limits: what its derivatives reach between them counts too."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment, anchor, segment_of
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.geometry.spline_curve import spline_part
from mcserver.motion.kernels.spline_samples import greatest_between
from mcserver.motion.smoothing.chord_smoothing import ChordSmoother, SmoothRun
from tests.bench.motion_laws import broken_laws, program_of
from tests.motion.support import alike, plan, polyline
from tests.motion.test_laws import law

SPEED = 0.1
# What the cubic between two samples misses of an extreme, by order: the fourth derivative is straight from
# knot to knot, and knots stand between samples.
MISSED = (1.0 + 2e-4, 1.0 + 1e-3, 1.0 + 5e-3)


def curves_of(points: Array, tolerance: float = 5e-4) -> list[SmoothRun]:
    """The curves that stand for chords through points (n, 2) [m]."""
    machine = alike(2, jerk=50_000.0)
    linear, position = np.ones(2, np.bool_), points[0].copy()
    lines: list[Segment] = []
    for number, group in enumerate(polyline(machine, points.tolist(), SPEED), start=1):
        lines.append(segment_of(group, number, {0: 0, 1: 1}, linear))
        anchor(lines[-1], position)
        lines[-1].tolerance = tolerance
    items = ChordSmoother(AxisLimits.of(machine)).smooth(SegmentList(lines), rests=True)
    return [item for item in items if isinstance(item, SmoothRun)]


def waves(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    along = np.cumsum(rng.uniform(5e-4, 4e-3, 40))
    return np.column_stack((along, 1e-3 * np.sin(along / rng.uniform(1e-3, 5e-3))))


def assert_sampled(curve: SmoothRun, shares: Array) -> None:
    """No derivative passes the samples at these shares of each part, nor its speed F."""
    samples = curve.samples
    for index, part in enumerate(curve.parts):
        own = spline_part(part)
        assert own is not None
        found = own.spline.at(own.low + shares * (own.high - own.low))
        rows = samples.rows[samples.offset[index] : samples.offset[index + 1]]
        for order in range(3):
            most = rows[:, 2 * order : 2 * order + 2].max(axis=0)
            assert (np.abs(found[order + 1]).max(axis=0) <= most * MISSED[order] + 1e-12).all()
        fastest = float(np.linalg.norm(found[1], axis=1).max()) * samples.spans[index]
        assert part.feed * fastest <= SPEED * MISSED[0]


@pytest.mark.parametrize("seed", range(4))
def test_no_derivative_of_a_curve_passes_its_samples_and_its_speed_is_f_at_the_most(seed: int) -> None:
    curves = curves_of(waves(seed))
    assert curves
    for curve in curves:
        assert_sampled(curve, np.linspace(0.0, 1.0, 400))


def test_a_long_line_behind_tiny_ones_has_samples_where_its_knots_are() -> None:
    # evenly it had some hundred thousands
    points = np.array([[0.0, 0.0], [3e-6, 9.6e-6], [1.3e-5, 9.6e-6], [0.5, 9.6e-6], [0.55, 9.6e-6]])
    curves = curves_of(points, 1e-5)
    assert curves
    for curve in curves:
        assert len(curve.samples.rows) <= 2000 * len(curve.parts)
        near = np.geomspace(1e-7, 0.5, 300)
        assert_sampled(curve, np.concatenate((near, 1.0 - near)))


@given(
    coefficients=st.lists(st.floats(-1.0, 1.0, allow_subnormal=False), min_size=4, max_size=4),
    apart=st.sampled_from([1e-6, 0.1, 1.0, 30.0]),
)
@law(200)
def test_the_greatest_value_of_a_cubic_with_one_extreme_between_its_ends_is_exact(
    coefficients: list[float], apart: float
) -> None:
    cubic = np.polynomial.Polynomial(coefficients)
    slope = cubic.deriv()
    found = greatest_between(
        float(cubic(0.0)), float(slope(0.0)) / apart, float(cubic(1.0)), float(slope(1.0)) / apart, apart
    )
    dense = float(np.abs(cubic(np.linspace(0.0, 1.0, 2001))).max())
    ends = max(abs(float(cubic(0.0))), abs(float(cubic(1.0))))
    if slope(0.0) * slope(1.0) < 0.0:
        assert found == pytest.approx(dense, rel=1e-5, abs=1e-9)
    else:
        assert found == pytest.approx(ends, abs=1e-9)


# F 1.0030, velocity 1.0012 and acceleration 1.0135 with the values at the samples alone
@pytest.mark.parametrize("seed", [6570, 21129, 381])
def test_rows_between_samples_of_a_curve_keep_f_and_the_limits(seed: int) -> None:
    machine, moves, commits = program_of(seed)
    assert broken_laws(plan(machine, moves, commits=commits)) == []
