"""Mesh files of links: read by trimesh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mcserver.view.solids import Colour, Solid
from mcserver.view.urdf import GREY

MOST_BYTES = 64 * 1024 * 1024


def load_mesh(path: Path, colour: Colour | None) -> Sequence[Solid]:
    """Return the bodies in a mesh file (STL, OBJ, DAE, GLB, PLY); ``colour`` goes before their own.

    Raises:
        ValueError: it is no mesh, or too large.
        OSError: it cannot be read.
    """
    import trimesh

    if path.stat().st_size > MOST_BYTES:
        raise ValueError(f"{path} is larger than {MOST_BYTES} bytes")
    try:
        loaded = trimesh.load_scene(path)
        bodies = loaded.dump()
    except OSError:
        raise
    except Exception as error:  # readers of many formats, each with errors of its own
        raise ValueError(f"{path} is no mesh that can be read: {error}") from error
    solids = []
    for body in bodies:
        if isinstance(body, trimesh.Trimesh) and len(body.faces):
            vertices, faces = np.asarray(body.vertices, float), np.asarray(body.faces, np.int64)
            solids.append(Solid(vertices, faces, colour or _main_colour(body)))
    if not solids:
        raise ValueError(f"{path} holds no triangles")
    return solids


def _main_colour(body: object) -> Colour:
    material = getattr(getattr(body, "visual", None), "material", None)
    found = getattr(material, "main_color", None)
    if found is None or len(found) < 3:
        return GREY
    red, green, blue = (int(value) for value in found[:3])
    return red, green, blue
