"""Boxes around what stands: for pictures, without a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mckinematics.rotation import rotation_matrices
from numpy.typing import NDArray

from mcserver.machine.clearance_section import (
    Body,
    BoxBody,
    CapsuleBody,
    Clearance,
    CylinderBody,
    SphereBody,
    Zone,
)
from mcserver.units import DEGREE

# corners of a cube of edge 1
UNIT = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


class Outline(NamedTuple):
    """A box around a body or zone; ``corners``: shape (8, 3), in the base's frame [mm]."""

    name: str
    zone: bool
    corners: NDArray[np.float64]


def standing_outlines(clearance: Clearance) -> list[Outline]:
    """Return the boxes of zones, and of bodies that nothing carries; meshes have none."""
    found = []
    for each in (*clearance.bodies, *clearance.zones):
        zone = isinstance(each, Zone)
        if not isinstance(each, Zone) and (each.link is not None or each.carried_by):
            continue
        edges = each.size_mm if isinstance(each, Zone) else _edges(each)
        if edges is not None:
            found.append(Outline(each.name, zone, _corners(edges, each.at_mm, each.turned_deg)))
    return found


def _edges(body: Body) -> tuple[float, float, float] | None:
    match body:
        case BoxBody():
            return body.size_mm
        case SphereBody():
            return (2.0 * body.radius_mm,) * 3
        case CylinderBody():
            return 2.0 * body.radius_mm, 2.0 * body.radius_mm, body.length_mm
        case CapsuleBody():
            return 2.0 * body.radius_mm, 2.0 * body.radius_mm, body.length_mm + 2.0 * body.radius_mm
    return None


def turned(angles_deg: Sequence[float]) -> NDArray[np.float64]:
    """Return the rotation Rz(C)·Ry(B)·Rx(A), shape (3, 3)."""
    rotation = np.eye(3)
    for axis, angle in enumerate(angles_deg):
        rotation = rotation_matrices((np.eye(3)[axis] * angle * DEGREE)[None])[0] @ rotation
    return rotation


def _corners(
    edges: tuple[float, float, float], at: tuple[float, float, float], angles: tuple[float, float, float]
) -> NDArray[np.float64]:
    corners: NDArray[np.float64] = (UNIT * np.array(edges)) @ turned(angles).T + np.array(at)
    return corners
