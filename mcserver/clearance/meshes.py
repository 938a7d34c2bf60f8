"""Meshes as their convex hulls, and those that are refused."""

from __future__ import annotations

import importlib
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mcserver.errors import ConfigurationError
from mcserver.units import MM

# Size of a mesh file that is read at all, in some seconds [bytes].
MOST_BYTES = 16 << 20
# Corners of a mesh whose hull is computed: some seconds, where all of them are on it.
MOST_CORNERS = 100_000
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
    """Return a mesh's convex hull; any other shape as it is.

    Raises:
        ConfigurationError: MC323 the mesh of the body of this name has no hull.
    """
    if not isinstance(geometry, importlib.import_module("coal").BVHModelBase):
        return geometry
    corners = np.asarray(geometry.vertices())
    hint = "correct the mesh, or give a box, cylinder or capsule instead"
    if len(corners) > MOST_CORNERS:
        hint = f"simplify it to {MOST_CORNERS} at the most"
        raise ConfigurationError("MC323", f"the mesh of {name!r} has {len(corners)} corners", hint)
    if not np.isfinite(corners).all():
        raise ConfigurationError("MC323", f"the mesh of {name!r} has corners that are no numbers", hint)
    # how thick it is along its three main directions
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    if len(spread) < 3 or spread[-1] < THINNEST:
        raise ConfigurationError("MC323", f"the mesh of {name!r} is flat, and has no hull", hint)
    geometry.buildConvexHull(True, "Qt")
    return geometry.convex


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
            f"simplify it to {MOST_CORNERS} corners at the most",
        )
