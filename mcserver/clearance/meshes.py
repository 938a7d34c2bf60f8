"""Meshes as convex hulls, or polytopes around them where they are too fine, and those that are refused."""

from __future__ import annotations

import importlib
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.errors import ConfigurationError
from mcserver.units import MM

Array = NDArray[np.float64]

# Size of a mesh file that is read at all, in some seconds and 0.7 GB of memory [bytes].
MOST_BYTES = 32 << 20
# Corners of a mesh whose hull is computed: a second, where all of them are on it, and 30 µs a distance.
MOST_CORNERS = 100_000
# Planes of the polytope around a mesh of more corners; and by what share of itself it is larger than these
# planes bound, for their rounding.
PLANES = 500
ROUNDING = 1e-9
# A mesh whose corners are off their middle plane by less than this, all together, has no hull [m].
THINNEST = 1e-6


def load_hull(file: str, name: str) -> Any:
    """Return the convex hull of a mesh file in mm, for the body of this name.

    Raises:
        ConfigurationError: MC323 it is not there, too large or no mesh, or has no hull.
    """
    path = Path(file)
    _refuse_large(path, f"the mesh {file!r} of {name!r}")
    try:
        mesh = importlib.import_module("coal").MeshLoader().load(file, np.full(3, MM))
    except (ValueError, RuntimeError) as error:
        reason = "cannot be read" if path.is_file() else "cannot be read: it is not there"
        raise ConfigurationError(
            "MC323",
            f"the mesh {file!r} of {name!r} {reason}",
            "give an STL, OBJ or DAE file, relative to the machine file",
        ) from error
    return hull_of(mesh, name)


def hull_of(geometry: Any, name: str) -> Any:
    """Return a mesh's convex hull, or what encloses one that is too fine; any other shape as it is.

    Raises:
        ConfigurationError: MC323 the mesh of the body of this name has no hull.
    """
    if not isinstance(geometry, importlib.import_module("coal").BVHModelBase):
        return geometry
    corners = np.asarray(geometry.vertices())
    hint = "correct the mesh, or give a box, cylinder or capsule instead"
    if not np.isfinite(corners).all():
        raise ConfigurationError("MC323", f"the mesh of {name!r} has corners that are no numbers", hint)
    # how thick it is along its three main directions
    _, spread, main = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)
    if len(spread) < 3 or spread[-1] < THINNEST:
        raise ConfigurationError("MC323", f"the mesh of {name!r} is flat, and has no hull", hint)
    if len(corners) > MOST_CORNERS:
        return _hull(enclosing_corners(corners, main))
    geometry.buildConvexHull(True, "Qt")
    return geometry.convex


def enclosing_corners(corners: Array, main: Array) -> Array:
    """Return the corners of a polytope of `PLANES` planes around points that are not flat, shape (m, 3).

    Each plane touches the points from outside, so that none of them is beyond any: a ball is enclosed to 1 %.

    Args:
        corners: shape (n, 3). main: its main directions, rows of shape (3, 3).
    """
    from scipy.spatial import HalfspaceIntersection

    along = corners @ main.T
    middle, half = 0.5 * (along.max(axis=0) + along.min(axis=0)), 0.5 * np.ptp(along, axis=0)
    # as wide as they are long, so that directions are spread over the points as they lie
    scaled = (along - middle) / half
    # a Fibonacci lattice on the sphere, and the six sides of the box
    number = np.arange(PLANES - 6) + 0.5
    angle, height = np.pi * (1.0 + math.sqrt(5.0)) * number, 1.0 - 2.0 * number / (PLANES - 6)
    radius = np.sqrt(1.0 - height**2)
    normals = np.vstack(
        [np.column_stack([np.cos(angle) * radius, np.sin(angle) * radius, height]), np.eye(3), -np.eye(3)]
    )
    reach = np.array([float((scaled @ normal).max()) for normal in normals])
    inside = scaled.mean(axis=0)
    planes = np.column_stack([normals, -reach])
    found = inside + (1.0 + ROUNDING) * (HalfspaceIntersection(planes, inside).intersections - inside)
    return np.asarray((found * half + middle) @ main)


def _hull(corners: Array) -> Any:
    coal = importlib.import_module("coal")
    points = coal.StdVec_Vec3s()
    for corner in corners:
        points.append(corner)
    return coal.Convex.convexHull(points, True, "Qt")


def refuse_large_meshes(urdf: str, folders: Sequence[str]) -> None:
    """Refuse a URDF whose meshes are too large to be read.

    Args:
        urdf: its text. folders: where ``package://`` begins.

    Raises:
        ConfigurationError: MC323 the first of them.
    """
    for mesh in ElementTree.fromstring(urdf).iter("mesh"):
        name = mesh.get("filename", "")
        scheme, separator, rest = name.partition("://")
        tail = rest if separator else scheme
        places = [Path(tail), *(Path(folder) / tail.lstrip("/") for folder in folders)]
        for place in places:
            _refuse_large(place, f"the mesh {name!r} of the URDF")


def _refuse_large(file: Path, what: str) -> None:
    if file.is_file() and file.stat().st_size > MOST_BYTES:
        raise ConfigurationError(
            "MC323",
            f"{what} has more than {MOST_BYTES >> 20} MiB",
            "simplify it",
        )
