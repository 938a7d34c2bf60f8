"""Chords before and behind an arc or another curve go over into it without a rest, within the tolerance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.motion.measure import assert_kept
from tests.motion.support import Commit, Motion, Move, alike, arc_curve, at_speed, plan, polyline

RADIUS, SPEED, TOLERANCE = 0.02, 0.1, 2e-5
MACHINE = alike(2, velocity=1000.0, acceleration=10_000.0, jerk=200_000.0)


def at(index: int) -> tuple[float, float]:
    """The point of a circle about the origin after so many quarters."""
    return RADIUS * math.cos(0.5 * math.pi * index), RADIUS * math.sin(0.5 * math.pi * index)


def chords(index: int, count: int) -> list[Move]:
    angles = 0.5 * math.pi * (index + np.arange(count + 1) / count)
    points = RADIUS * np.column_stack((np.cos(angles), np.sin(angles)))
    groups = polyline(MACHINE, points.tolist(), SPEED)
    return [Move(group, tolerance=TOLERANCE) for group in groups]


def arc(index: int) -> Move:
    return Move(at_speed(SPEED, arc_curve(at(index), (0.0, 0.0), 0.5 * math.pi)), tolerance=TOLERANCE)


def speeds(motion: Motion) -> np.ndarray:
    return np.linalg.norm(np.diff(motion.position[:, :2], axis=0), axis=1) / motion.cycle


@pytest.mark.parametrize("count", [20, 40, 200])
@pytest.mark.parametrize("commits", [(), (8, 11, 14), (13, 15, 30)])
def test_chords_an_arc_and_chords_flow(count: int, commits: tuple[int, ...]) -> None:
    moves = [*chords(0, count), arc(1), *chords(2, count)]
    motion = plan(
        MACHINE,
        moves,
        start=np.array([RADIUS, 0.0]),
        commits=[Commit(after, 40.0) for after in commits if after < len(moves)],
    )
    assert_kept(motion, TOLERANCE)
    assert speeds(motion)[100:-100].min() > 0.9 * SPEED


def test_a_corner_between_chords_and_an_arc_stays_one() -> None:
    x, y = at(1)
    turned = arc_curve((x, y), (x + RADIUS, y), 0.5 * math.pi)
    moves = [*chords(0, 40), Move(at_speed(SPEED, turned), tolerance=TOLERANCE)]
    motion = plan(MACHINE, moves, start=np.array([RADIUS, 0.0]))
    assert_kept(motion, TOLERANCE)
    assert speeds(motion)[100:-100].min() < 0.5 * SPEED


def test_an_arc_that_must_be_begun_from_rest_is() -> None:
    moves = [*chords(0, 40), Move(arc(1).group, from_rest=True), *chords(2, 40)]
    motion = plan(MACHINE, moves, start=np.array([RADIUS, 0.0]))
    assert_kept(motion, TOLERANCE)
    # the rest may be half a cycle from the nearest row, at the greatest jerk
    nearest = MACHINE.axes[0].max_jerk * (0.5 * motion.cycle) ** 3 / 6.0
    assert np.linalg.norm(motion.position[:, :2] - at(1), axis=1).min() < nearest
