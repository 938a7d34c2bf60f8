"""A machine as frames and bodies: the robot of its URDF, or a portal, its tips, what it carries."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from mckinematics.solver import MachineKinematics

from mcserver.clearance.outlines import turned
from mcserver.errors import ConfigurationError
from mcserver.machine.axis import axis_name
from mcserver.machine.clearance_section import Body, Clearance, MeshBody, Zone, measures
from mcserver.machine.machine_file import Machine
from mcserver.net.model_methods import look
from mcserver.units import MM, AxisType
from mcserver.view.bodies import BODY, ZONE, body_solids
from mcserver.view.gantry import gantry_parts, gantry_space
from mcserver.view.meshes import load_mesh
from mcserver.view.robot import robot_parts
from mcserver.view.solids import Array, Part, Solid
from mcserver.view.stage import Tool, Up, tree_up, work_links
from mcserver.view.urdf import Joint, Link, Tree, read_tree

# frames: all others hang on the first one, which stands with Z up
WORLD, PORTAL = "world", "machine"


class Shape(NamedTuple):
    """What a machine looks like.

    Attributes:
        tree: its links, and frames of tips and carriages. up: shape (3,), which way of its root is up.
        columns: of the axes, by the joint (or leader) that each moves. joints: names for people, by column.
        parts, zones: solids in the frame of that name. urdf: text; empty: a portal.
        bases: frames in which the poses of tools are, by number; those left out are in the root's.
    """

    tree: Tree
    up: Array
    columns: Mapping[str, int]
    joints: Sequence[str]
    parts: Sequence[Part]
    zones: Sequence[Part]
    urdf: str
    bases: Mapping[int, str] = MappingProxyType({})


class Looks(NamedTuple):
    """What a machine says of its looks: its URDF, joints by axis, files of meshes by their names there."""

    urdf: str = ""
    joints: Mapping[int, str] = MappingProxyType({})
    meshes: Mapping[str, Path] = MappingProxyType({})


def shape_of(machine: Machine, kinematics: MachineKinematics | None, points: Array) -> Shape:
    """Return a machine's shape, with its tools' tips and the bodies of its clearance.

    Args:
        kinematics: None with tools: the URDF is on another computer.
        points: shape (N, 3), where the axes 0, 1 and 2 have been, for the size of a portal [m].

    Raises:
        Refused: MC587 its URDF cannot be read. ConfigurationError: MC323 a body's mesh cannot be read.
    """
    looks = Looks()
    if kinematics is not None:
        found, paths = look(machine)
        named = {mesh.name: path for mesh, path in zip(found.meshes, paths, strict=True)}
        looks = Looks(
            found.urdf,
            {int(axis): name for axis, name in found.joints.items()},
            {name: path for name, path in named.items() if path is not None},
        )
    linear = {axis.index: axis.type is AxisType.LINEAR for axis in machine.axes}
    shape = bare_shape(linear, looks, machine.tools, points)
    extra = _tips(shape.tree, machine)
    parts, zones, root = list(shape.parts), [], shape.tree.root
    if machine.clearance is not None:
        extra += _carriages(root, machine.clearance)
        parts += [
            _body_part(body, root)
            for body in machine.clearance.bodies
            if body.tool is None and (body.link is None or body.link in shape.tree.links)
        ]
        zones = [_zone_part(zone, root) for zone in machine.clearance.zones if zone.fixed]
    links = {joint.child: Link(joint.child, ()) for joint in extra}
    tree = Tree(root, {**shape.tree.links, **links}, (*shape.tree.joints, *extra))
    return shape._replace(tree=tree, parts=parts, zones=zones)


def bare_shape(linear: Mapping[int, bool], looks: Looks, tools: Iterable[Tool], points: Array) -> Shape:
    """Return the shape of a machine of which only this is known; `points` as in `shape_of`.

    Args:
        linear: by axis index, in the order of the columns; the others are rotary.
    """
    names = [axis_name(index) for index in linear]
    columns = {_axis_key(index): column for column, index in enumerate(linear)}
    if not looks.urdf:
        tree, parts = _portal({index for index in (0, 1, 2) if linear.get(index)}, points)
        return Shape(tree, np.eye(3)[2], columns, names, parts, (), "")
    tree = read_tree(looks.urdf)
    for column, index in enumerate(linear):
        if index in looks.joints:
            names[column] = looks.joints[index]
            columns[names[column]] = column
    up = tree_up(tree, looks.joints, tools, Up.AUTO)
    bases = work_links(tree, tools)
    return Shape(tree, up, columns, names, robot_parts(tree, looks.meshes), (), looks.urdf, bases)


def _axis_key(index: int) -> str:
    return f"axis/{index}"


def _portal(linear: Container[int], points: Array) -> tuple[Tree, tuple[Part, ...]]:
    """Return the frames Y, X and Z, one on the other, and the parts that hang on them."""
    frames = {"rails": PORTAL, "bridge": "Y", "carriage": "X", "quill": "Z"}
    joints, parent = [], PORTAL
    for child, axis in (("Y", 1), ("X", 0), ("Z", 2)):
        kind = "prismatic" if axis in linear else "fixed"
        joints.append(Joint(_axis_key(axis), kind, parent, child, np.eye(4), np.eye(3)[axis]))
        parent = child
    tree = Tree(PORTAL, {name: Link(name, ()) for name in frames.values()}, tuple(joints))
    drawn = gantry_parts(*gantry_space(points)) if linear else ()
    return tree, tuple(Part(frames[part.name], part.solids) for part in drawn)


def _tips(tree: Tree, machine: Machine) -> tuple[Joint, ...]:
    """Return the frames of the tools, such as T3; one that a joint names is that of the link behind it."""
    behind = {joint.name: joint.child for joint in tree.joints}
    found = []
    for tool in machine.tools:
        pose = np.eye(4)
        pose[:3, 3] = tool.offset
        parent = tool.frame if tool.frame in tree.links else behind.get(tool.frame, "")
        if parent:
            name = f"T{tool.number}"
            found.append(Joint(name, "fixed", parent, name, pose, np.eye(3)[0]))
    return tuple(found)


def _carriages(root: str, clearance: Clearance) -> tuple[Joint, ...]:
    """Return a chain of sliding frames for each way in which axes carry bodies."""
    made: dict[str, Joint] = {}
    for body in clearance.bodies:
        parent, ratio = root, -1.0 if body.opposite else 1.0
        for count, axis in enumerate(body.carried_by if body.link is None else (), start=1):
            child = _carriage_name(body, count)
            direction = np.eye(3)[clearance.letters[axis]]
            leader = _axis_key(axis)
            made.setdefault(
                child, Joint(child, "prismatic", parent, child, np.eye(4), direction, leader, ratio)
            )
            parent = child
    return tuple(made.values())


def _carriage_name(body: Body, count: int) -> str:
    words = "-".join(str(axis) for axis in body.carried_by[:count])
    return f"carriage {words}{' opposite' if body.opposite else ''}"


def _body_part(body: Body, root: str) -> Part:
    carried = _carriage_name(body, len(body.carried_by)) if body.carried_by else root
    pose = _pose(body)
    return Part(body.link or carried, tuple(solid.moved(pose) for solid in _solids(body)))


def _zone_part(zone: Zone, root: str) -> Part:
    (solid,) = body_solids("box", zone.size_mm, ZONE)
    return Part(root, (solid.moved(_pose(zone)),))


def _pose(placed: Body | Zone) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = turned(placed.turned_deg)
    pose[:3, 3] = np.array(placed.at_mm) * MM
    return pose


def _solids(body: Body) -> Sequence[Solid]:
    if not isinstance(body, MeshBody):
        # the shape of a machine stays as it is: what programs fit is not in it
        return body_solids(*measures(body))
    try:
        scale = np.diag([MM, MM, MM, 1.0])
        return [solid.moved(scale) for solid in load_mesh(Path(body.file), BODY)]
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            "MC323",
            f"the mesh {body.file!r} of {body.name!r} cannot be read: {error}",
            "give an STL, OBJ or DAE file, relative to the machine file",
        ) from error
