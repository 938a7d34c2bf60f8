"""Bezier curves as motion (D-97): limits, F and the path, and a circle that is one exactly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.rational_curve import Cusp, RationalCurve, rational_curve
from mcserver.units import MM
from tests.motion.measure import (
    ACCELERATION_SLACK,
    JERK_SLACK,
    VELOCITY_SLACK,
    acceleration_ratio,
    jerk_ratio,
    row_velocity_ratio,
    speed_over_feed,
    velocity_ratio,
    vertices_of,
)
from tests.motion.support import Move, alike, at_speed, plan
from tests.motion.test_laws import law

PLACES = st.floats(-40.0, 40.0).map(lambda value: round(value, 3) * MM)


@st.composite
def chains(draw: st.DrawFn) -> list[RationalCurve]:
    """Up to four curves, the next one going on in the direction of the one before, or not."""
    found: list[RationalCurve] = []
    place, leaving = np.zeros(2), None
    for _ in range(draw(st.integers(1, 4))):
        points: Array = np.array([[draw(PLACES), draw(PLACES)] for _ in range(draw(st.integers(2, 3)))])
        if leaving is not None and draw(st.booleans()):
            points[0] = place + leaving
        points = np.vstack((place, points))
        weights = np.array([1.0, *(draw(st.sampled_from([0.5, 1.0, 3.0])) for _ in points[2:]), 1.0])
        try:
            found.append(rational_curve((0, 1), points, weights))
        except Cusp:
            assume(False)
        place, leaving = points[-1], points[-1] - points[-2]
    return found


@given(
    chains(),
    st.sampled_from([5.0, 60.0, 1000.0]),
    st.sampled_from([None, 20000.0]),
    st.sampled_from([0.0, 0.0, 0.2]),
)
@law(20)
def test_limits_feed_and_path_are_kept(
    curves: list[RationalCurve], feed: float, jerk: float | None, tolerance: float
) -> None:
    machine = alike(velocity=150.0, acceleration=1500.0, jerk=jerk)
    motion = plan(machine, [Move(at_speed(feed * MM, each), tolerance=tolerance * MM) for each in curves])
    assert velocity_ratio(motion) <= VELOCITY_SLACK
    assert row_velocity_ratio(motion) <= VELOCITY_SLACK
    assert acceleration_ratio(motion) <= ACCELERATION_SLACK
    assert speed_over_feed(motion) <= VELOCITY_SLACK
    if jerk is not None:
        passed = () if tolerance else vertices_of(motion)
        assert jerk_ratio(motion, vertices=passed) <= JERK_SLACK
    path = np.vstack([curve.position(np.linspace(0.0, 1.0, 2001)) for curve in curves])
    longest = max(curve.length for curve in curves)
    for row in motion.position[:: max(1, len(motion.position) // 100)]:
        assert np.linalg.norm(path - row, axis=1).min() <= tolerance * MM + longest / 2000.0


@given(chains())
@law(20)
def test_s_is_the_share_of_the_length(curves: list[RationalCurve]) -> None:
    for curve in curves:
        s = np.linspace(0.0, 1.0, 2_001)
        steps = np.linalg.norm(np.diff(curve.position(s), axis=0), axis=1)
        assert steps.sum() == pytest.approx(curve.length, rel=1e-3)
        # the sharpest bends that are taken come to 2e-4 of the speed, most to 1e-9
        assert np.linalg.norm(curve.derivatives(s)[0], axis=1) == pytest.approx(curve.length, rel=5e-4)


def test_a_quarter_of_a_circle_has_its_angles() -> None:
    corner = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    curve = rational_curve((0, 1), corner, np.array([1.0, math.sqrt(0.5), 1.0]))
    s = np.linspace(0.0, 1.0, 101)
    angle = s * math.pi / 2.0
    circle = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    assert curve.length == pytest.approx(math.pi / 2.0, rel=1e-12)
    np.testing.assert_allclose(curve.position(s), circle, atol=1e-12)
    for order, found in enumerate(curve.derivatives(s), start=1):
        turned = angle + order * math.pi / 2.0
        expected = (math.pi / 2.0) ** order * np.stack((np.cos(turned), np.sin(turned)), axis=1)
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_f_is_kept_all_along_a_gentle_curve() -> None:
    points = np.array([[0.0, 0.0], [5.0, 30.0], [60.0, 40.0], [100.0, 0.0]]) * MM
    motion = plan(alike(acceleration=5000.0), [Move(at_speed(20.0 * MM, rational_curve((0, 1), points)))])
    speeds = np.linalg.norm(np.diff(motion.position, axis=0), axis=1) / motion.cycle
    inside = speeds[50:-50]
    assert inside.min() == pytest.approx(20.0 * MM, rel=1e-5)
    assert inside.max() <= 20.0 * MM * (1.0 + 1e-9)


@pytest.mark.parametrize(
    "points",
    [
        [[0, 0], [0, 0], [5, 5], [10, 0]],
        [[0, 0], [10, 10], [0, 10], [10, 0]],
        [[0, 0], [10, 0], [-10, 0], [5, 0]],
        [[0, 0], [10, 0.01], [0, 0.02]],
    ],
)
def test_cusps_and_places_where_it_stands_are_refused(points: list[list[float]]) -> None:
    with pytest.raises(Cusp):
        rational_curve((0, 1), np.array(points, dtype=float) * MM)
