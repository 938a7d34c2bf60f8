"""A robot of a URDF: its visuals where they can be had, else its bones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from mcserver.machine.mesh_files import find_mesh
from mcserver.view.body import Part
from mcserver.view.solids import Array, Colour, Solid, ball, box, capsule, cylinder
from mcserver.view.urdf import GREY, Look, Tree

BONE: Colour = (66, 104, 148)
# of a bone, as a share of the robot's size
THICKNESS = 0.014

LoadMesh = Callable[[Path, Colour | None], Sequence[Solid]]


class Robot:
    """A `Body` of a URDF.

    Args:
        tree: the robot. joints: names of its joints by axis number; others stay at zero.
        urdf: the file, for its meshes. roots: folders of further packages.
        load_mesh: reads a mesh file; raises ValueError or OSError where it cannot.
    """

    def __init__(
        self,
        tree: Tree,
        joints: Mapping[int, str],
        urdf: Path,
        load_mesh: LoadMesh,
        roots: Sequence[Path] = (),
    ) -> None:
        self._tree = tree
        self._joints = dict(joints)
        missing: list[str] = []
        radius = THICKNESS * _extent(tree)
        parts = []
        for name, link in tree.links.items():
            solids: list[Solid] = []
            for look in link.looks:
                try:
                    shapes = _solids(look, urdf, roots, load_mesh)
                except (OSError, ValueError):
                    missing.append(look.mesh)
                    continue
                solids += [shape.moved(look.pose) for shape in shapes]
            parts.append(Part(name, tuple(solids) if solids else _bones(tree, name, radius)))
        self._parts, self._missing = tuple(parts), tuple(missing)

    @property
    def parts(self) -> tuple[Part, ...]:
        """Its links."""
        return self._parts

    @property
    def frames(self) -> tuple[str, ...]:
        """Links that a joint of an axis moves."""
        moved = set(self._joints.values())
        return tuple(joint.child for joint in self._tree.joints if joint.name in moved)

    @property
    def missing_meshes(self) -> tuple[str, ...]:
        """Meshes whose links are drawn as bones."""
        return self._missing

    def poses(self, positions: Mapping[int, float]) -> dict[str, Array]:
        """Each link's frame, shape (4, 4)."""
        return self._tree.poses(
            {name: positions[axis] for axis, name in self._joints.items() if axis in positions}
        )


def _solids(look: Look, urdf: Path, roots: Sequence[Path], load_mesh: LoadMesh) -> Sequence[Solid]:
    colour = look.colour or GREY
    if look.kind == "box":
        return [box(np.array(look.size), colour)]
    if look.kind == "cylinder":
        radius, length = look.size
        return [cylinder(radius, length, colour)]
    if look.kind == "sphere":
        return [ball(look.size[0], colour)]
    found = find_mesh(look.mesh, urdf, roots)
    if found is None:
        raise FileNotFoundError(look.mesh)
    scale = np.diag([*look.size, 1.0])
    return [solid.moved(scale) for solid in load_mesh(found, look.colour)]


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
