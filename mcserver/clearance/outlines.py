"""Boxes around what stands: for pictures, without a model."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mckinematics.rotation import euler_to_matrix
from numpy.typing import NDArray

from mcserver.machine.clearance_section import (
    Body,
    BoxBody,
    CapsuleBody,
    Clearance,
    CylinderBody,
    Place,
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
    """Return the boxes of zones and bodies that stand where the machine file says; meshes have none."""
    found = []
    for each in (*clearance.bodies, *(zone for zone in clearance.zones if zone.fixed)):
        if isinstance(each, Zone):
            edges: Place | None = each.size_mm
        else:
            carried = each.link is not None or each.carried_by
            edges = None if carried else _edges(each)
        if edges is not None:
            corners = _corners(edges, each.at_mm, each.turned_deg)
            found.append(Outline(each.name, isinstance(each, Zone), corners))
    return found


def _edges(body: Body) -> Place | None:
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


def turned(angles_deg: Place) -> NDArray[np.float64]:
    """Return the rotation Rz(C)·Ry(B)·Rx(A), shape (3, 3)."""
    a, b, c = (angle * DEGREE for angle in angles_deg)
    return euler_to_matrix((a, b, c), "ZYX")


def _corners(edges: Place, at: Place, angles: Place) -> NDArray[np.float64]:
    corners: NDArray[np.float64] = (UNIT * np.array(edges)) @ turned(angles).T + np.array(at)
    return corners
