"""A robot of a URDF: its visuals where they can be had, else its bones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from mcserver.view.meshes import load_mesh
from mcserver.view.solids import Colour, Part, Solid, ball, box, capsule, cylinder
from mcserver.view.urdf import GREY, Look, Tree

BONE: Colour = (66, 104, 148)
# of a bone, as a share of the robot's size
THICKNESS = 0.014

LoadMesh = Callable[[Path, Colour | None], Sequence[Solid]]


def robot_parts(tree: Tree, meshes: Mapping[str, Path], load: LoadMesh = load_mesh) -> tuple[Part, ...]:
    """Return the links of a robot as solids; a link whose mesh cannot be had is drawn as its bones.

    Args:
        meshes: files by the names that the URDF has for them.
        load: reads a mesh file; raises ValueError or OSError where it cannot.
    """
    radius = THICKNESS * _extent(tree)
    parts = []
    for name, link in tree.links.items():
        solids: list[Solid] = []
        for look in link.looks:
            try:
                shapes = _solids(look, meshes, load)
            except (OSError, ValueError, KeyError):
                continue
            solids += [shape.moved(look.pose) for shape in shapes]
        parts.append(Part(name, tuple(solids) if solids else _bones(tree, name, radius)))
    return tuple(parts)


def _solids(look: Look, meshes: Mapping[str, Path], load: LoadMesh) -> Sequence[Solid]:
    colour = look.colour or GREY
    if look.kind == "box":
        return [box(np.array(look.size), colour)]
    if look.kind == "cylinder":
        radius, length = look.size
        return [cylinder(radius, length, colour)]
    if look.kind == "sphere":
        return [ball(look.size[0], colour)]
    scale = np.diag([*look.size, 1.0])
    return [solid.moved(scale) for solid in load(meshes[look.mesh], look.colour)]


def _bones(tree: Tree, name: str, radius: float) -> tuple[Solid, ...]:
    """Rods from a link's own joint to the joints that it carries."""
    origin = np.zeros(3)
    ends = [joint.pose[:3, 3] for joint in tree.joints if joint.parent == name]
    rods = [capsule(origin, end, radius, BONE) for end in ends if np.linalg.norm(end) > radius]
    return (*rods, ball(1.3 * radius, GREY))


def _extent(tree: Tree) -> float:
    points = np.array([pose[:3, 3] for pose in tree.poses({}).values()])
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    return extent if extent > 0.0 else 1.0
