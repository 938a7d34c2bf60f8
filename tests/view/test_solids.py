"""Bodies of triangles: closed, turned outwards, of the right size."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mcserver.view.solids import Solid, ball, box, capsule, cylinder

GREY = (1, 2, 3)


def volume(solid: Solid) -> float:
    """By the divergence theorem: right only if every triangle is seen anticlockwise from outside [m³]."""
    a, b, c = (solid.vertices[solid.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize(
    ("solid", "expected"),
    [
        (box(np.array([0.2, 0.3, 0.5]), GREY), 0.03),
        (cylinder(0.1, 0.4, GREY), math.pi * 0.01 * 0.4),
        (ball(0.2, GREY), 4.0 / 3.0 * math.pi * 0.008),
        (
            capsule(np.array([0.1, 0.0, 0.0]), np.array([0.1, 0.3, 0.4]), 0.05, GREY),
            math.pi * 0.05**2 * 0.5 + 4.0 / 3.0 * math.pi * 0.05**3,
        ),
    ],
    ids=["box", "cylinder", "ball", "capsule"],
)
def test_bodies_are_closed_and_turned_outwards(solid: Solid, expected: float) -> None:
    assert volume(solid) == pytest.approx(expected, rel=0.03)


def test_a_capsule_ends_round_its_points() -> None:
    start, end = np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.2, -0.5])
    solid = capsule(start, end, 0.04, GREY)
    along = np.clip((solid.vertices - start) @ (end - start) / 0.64, 0.0, 1.0)
    nearest = start + along[:, None] * (end - start)
    np.testing.assert_allclose(np.linalg.norm(solid.vertices - nearest, axis=1), 0.04, atol=1e-12)


def test_a_moved_body_keeps_its_colour_and_goes_where_the_pose_says() -> None:
    pose = np.eye(4)
    pose[:3, 3] = 1.0, 2.0, 3.0
    moved = ball(0.1, GREY).moved(pose)
    np.testing.assert_allclose(moved.vertices.mean(axis=0), (1.0, 2.0, 3.0), atol=1e-12)
    assert moved.colour == GREY
