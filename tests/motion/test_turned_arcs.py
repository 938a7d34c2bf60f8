"""Arcs that are skew to the axes as motion (D-110): limits, F, the path, and their bounds."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mcserver.motion.geometry.curves import ArcCurve
from mcserver.motion.geometry.turned_arc import TurnedArc
from mcserver.units import MM
from tests.motion.measure import (
    ACCELERATION_SLACK,
    JERK_SLACK,
    VELOCITY_SLACK,
    acceleration_ratio,
    jerk_ratio,
    speed_over_feed,
    velocity_ratio,
    vertices_of,
)
from tests.motion.support import Move, alike, at_speed, plan
from tests.motion.test_laws import law


@st.composite
def arcs(draw: st.DrawFn) -> TurnedArc:
    """An arc of up to a few turns, or a helix, from zero, in a plane that is turned about two axes."""
    radius, sweep = (
        draw(st.floats(1.0, 30.0)) * MM,
        draw(st.floats(0.2, 20.0)) * draw(st.sampled_from([-1, 1])),
    )
    rise = draw(st.sampled_from([0.0, 15.0])) * MM
    a, b = draw(st.floats(-3.1, 3.1)), draw(st.floats(-3.1, 3.1))
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_z = np.array([[math.cos(b), -math.sin(b), 0], [math.sin(b), math.cos(b), 0], [0, 0, 1]])
    directions = about_z @ about_x
    end = (radius * math.cos(sweep), radius * math.sin(sweep), rise)
    length = math.hypot(radius * sweep, rise)
    flat = ArcCurve((0, 1, 2), (radius, 0.0, 0.0), end, (0.0, 0.0), sweep, length)
    zero = -directions @ np.array(flat.start)
    finish = zero + directions @ np.array(flat.end)
    rows = tuple(tuple(row) for row in directions.tolist())
    return TurnedArc((0, 1, 2), flat, rows, tuple(zero.tolist()), (0.0, 0.0, 0.0), tuple(finish.tolist()))


@given(arcs(), st.sampled_from([5.0, 60.0, 1000.0]), st.sampled_from([None, 20000.0]))
@law(12)
def test_limits_feed_and_path_are_kept(arc: TurnedArc, feed: float, jerk: float | None) -> None:
    machine = alike(3, velocity=150.0, acceleration=1500.0, jerk=jerk)
    motion = plan(machine, [Move(at_speed(feed * MM, arc))])
    assert velocity_ratio(motion) <= VELOCITY_SLACK
    assert acceleration_ratio(motion) <= ACCELERATION_SLACK
    assert speed_over_feed(motion) <= VELOCITY_SLACK
    if jerk is not None:
        assert jerk_ratio(motion, vertices=vertices_of(motion)) <= JERK_SLACK
    path = arc.position(np.linspace(0.0, 1.0, 4001))
    for row in motion.position[:: max(1, len(motion.position) // 50)]:
        assert np.linalg.norm(path - row, axis=1).min() <= arc.length / 4000.0


@given(arcs())
@law(30)
def test_its_bounds_are_those_of_its_places(arc: TurnedArc) -> None:
    points = arc.position(np.linspace(0.0, 1.0, 20001))
    low, high = arc.bounds()
    np.testing.assert_allclose([low, high], [points.min(axis=0), points.max(axis=0)], atol=1e-5 * 30 * MM)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert abs(steps.sum() - arc.length) <= 1e-5 * arc.length
