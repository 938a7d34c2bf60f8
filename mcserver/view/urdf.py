"""What a URDF says of a robot's looks: its tree of links, and what each link looks like."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from mckinematics.rotation import euler_to_matrix, rotation_matrices

from mcserver.view.solids import Array, Colour

GREY: Colour = (176, 182, 190)


@dataclass(frozen=True)
class Look:
    """One shape of a link.

    Attributes:
        kind: ``box``, ``cylinder``, ``sphere`` or ``mesh``.
        size: of a box its extent; radius and length of a cylinder; radius of a sphere; scale of a mesh.
        pose: shape (4, 4), in the link's frame. mesh: as the URDF writes it.
        colour: None where the URDF gives none.
    """

    kind: str
    size: tuple[float, ...]
    pose: Array
    colour: Colour | None
    mesh: str = ""


@dataclass(frozen=True)
class Link:
    """A link with its looks."""

    name: str
    looks: tuple[Look, ...]


@dataclass(frozen=True)
class Joint:
    """A joint between two links.

    Attributes:
        kind: as in URDF. pose: shape (4, 4), of the joint in its parent. axis: shape (3,), a unit vector.
        leader: joint that this one copies, times ``ratio`` plus ``offset``; empty: none.
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: Array
    axis: Array
    leader: str = ""
    ratio: float = 1.0
    offset: float = 0.0

    def child_pose(self, values: Mapping[str, float]) -> Array:
        """Return the child's frame in the parent's, shape (4, 4); ``values`` as of `Tree.poses`."""
        value = values.get(self.name, 0.0)
        if self.leader:
            value = self.ratio * values.get(self.leader, 0.0) + self.offset
        return self.pose @ _motion(self, value)


@dataclass(frozen=True)
class Tree:
    """A robot: links by name, and joints so ordered that each one's parent is placed before it."""

    root: str
    links: Mapping[str, Link]
    joints: tuple[Joint, ...]

    def poses(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Return each link's frame in the root's, shape (4, 4); ``values`` by joint's name [rad or m], else
        0.
        """
        placed = {self.root: np.eye(4)}
        for joint in self.joints:
            placed[joint.child] = placed[joint.parent] @ joint.child_pose(values)
        return placed


def read_tree(text: str) -> Tree:
    """Return the tree of a URDF that `mckinematics.model.load_model` has accepted. Raises ValueError."""
    robot = ElementTree.fromstring(text)
    named = {
        material.get("name", ""): colour
        for material in robot.iter("material")
        if (colour := _colour(material)) is not None
    }
    links = {
        name: Link(name, tuple(_looks(link, named)))
        for link in robot.findall("link")
        if (name := link.get("name", ""))
    }
    joints = [_joint(joint) for joint in robot.findall("joint")]
    children = {joint.child for joint in joints}
    root = next((name for name in links if name not in children), None)
    if root is None:
        raise ValueError("it has no link that is no other's child")
    ordered: list[Joint] = []
    placed = {root}
    while len(ordered) < len(joints):
        ready = [joint for joint in joints if joint.parent in placed and joint.child not in placed]
        if not ready:
            break
        ordered += ready
        placed |= {joint.child for joint in ready}
    return Tree(root, {name: link for name, link in links.items() if name in placed}, tuple(ordered))


def _looks(link: ElementTree.Element, named: Mapping[str, Colour]) -> list[Look]:
    looks = []
    for visual in link.findall("visual"):
        geometry, material = visual.find("geometry"), visual.find("material")
        if geometry is None or not len(geometry):
            continue
        colour = None if material is None else _colour(material) or named.get(material.get("name", ""))
        shape, pose = geometry[0], _pose(visual.find("origin"))
        if shape.tag == "box":
            looks.append(Look("box", _numbers(shape, "size", "1 1 1"), pose, colour))
        elif shape.tag == "cylinder":
            size = (float(shape.get("radius", "0")), float(shape.get("length", "0")))
            looks.append(Look("cylinder", size, pose, colour))
        elif shape.tag == "sphere":
            looks.append(Look("sphere", (float(shape.get("radius", "0")),), pose, colour))
        elif shape.tag == "mesh":
            scale = _numbers(shape, "scale", "1 1 1")
            looks.append(Look("mesh", scale, pose, colour, shape.get("filename", "")))
    return looks


def _joint(joint: ElementTree.Element) -> Joint:
    axis, mimic = joint.find("axis"), joint.find("mimic")
    direction = np.array((1.0, 0.0, 0.0) if axis is None else _numbers(axis, "xyz", "1 0 0"))
    return Joint(
        name=joint.get("name", ""),
        kind=joint.get("type", "fixed"),
        parent=_link(joint, "parent"),
        child=_link(joint, "child"),
        pose=_pose(joint.find("origin")),
        axis=direction / max(float(np.linalg.norm(direction)), 1e-12),
        leader="" if mimic is None else mimic.get("joint", ""),
        ratio=1.0 if mimic is None else float(mimic.get("multiplier", "1")),
        offset=0.0 if mimic is None else float(mimic.get("offset", "0")),
    )


def _motion(joint: Joint, value: float) -> Array:
    motion = np.eye(4)
    if joint.kind in ("revolute", "continuous"):
        motion[:3, :3] = rotation_matrices((joint.axis * value)[None])[0]
    elif joint.kind == "prismatic":
        motion[:3, 3] = joint.axis * value
    return motion


def _pose(origin: ElementTree.Element | None) -> Array:
    pose = np.eye(4)
    if origin is not None:
        pose[:3, 3] = _numbers(origin, "xyz", "0 0 0")
        roll, pitch, yaw = _numbers(origin, "rpy", "0 0 0")
        # fixed axes, X first
        pose[:3, :3] = euler_to_matrix((roll, pitch, yaw), "ZYX")
    return pose


def _colour(material: ElementTree.Element) -> Colour | None:
    colour = material.find("color")
    if colour is None:
        return None
    red, green, blue = (round(255.0 * share) for share in _numbers(colour, "rgba", "0.7 0.7 0.7 1")[:3])
    return red, green, blue


def _link(joint: ElementTree.Element, end: str) -> str:
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def _numbers(element: ElementTree.Element, key: str, missing: str) -> tuple[float, ...]:
    return tuple(float(word) for word in element.get(key, missing).split())
