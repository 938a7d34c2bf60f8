"""Machines with bodies."""

from __future__ import annotations

import copy
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from mckinematics.model import read_urdf
from numpy.typing import NDArray

from mcserver.clearance.scene import Scene
from mcserver.machine.machine_file import Machine, builtin_text, parse_machine

_AXIS = """
[[axis]]
index = {}
type = "linear"
max_velocity = 200.0
max_acceleration = 2000.0
drive = {{ kind = "ideal", initial_position = {} }}
"""
MILL = '[machine]\nname = "mill"\n' + "".join(
    _AXIS.format(index, start) for index, start in enumerate((0.0, 0.0, 100.0))
)
TOOL = """
[[body]]
name = "tool"
shape = "cylinder"
radius_mm = 5.0
length_mm = 60.0
at_mm = [0.0, 0.0, 30.0]
carried_by = [0, 1, 2]
"""
VISE = """
[[body]]
name = "vise"
shape = "box"
size_mm = [100.0, 60.0, 40.0]
at_mm = [150.0, 0.0, 20.0]
"""


def mill(*more: str) -> Machine:
    """A portal whose tip is at X0 Y0 Z100, with the tool as a body."""
    return parse_machine("\n".join((MILL, TOOL, *more)))


def shaped_mill(*more: str) -> Machine:
    """The same portal with shapers that leave its path by half a millimetre."""
    shaper = 'shaper = { type = "ei", frequency_hz = 20.0 }'
    text = MILL.replace("max_acceleration = 2000.0", f"max_acceleration = 2000.0\n{shaper}")
    return parse_machine("\n".join((text, "[motion]\npath_tolerance_mm = 0.6", TOOL, *more)))


def soft_mill(*more: str) -> Machine:
    """The same portal with drives that have inertia, and run on by friction when they are lost."""
    drives = MILL.replace('kind = "ideal"', 'kind = "simulated", bandwidth_hz = 200.0')
    return parse_machine("\n".join((drives, TOOL, *more)))


def arm(*more: str) -> Machine:
    """The built-in arm with sections more."""
    return parse_machine("\n".join((builtin_text("arm6"), *more)))


def two_arms(folder: Path, *more: str) -> Machine:
    """Two of the built-in arm beside each other, 700 mm apart, with axes 0-5 and 6-11, and tools 1 and 2."""
    one = ElementTree.fromstring(read_urdf("arm6.urdf"))
    cell = ElementTree.Element("robot", name="cell")
    cell.extend(one.findall("material"))
    ElementTree.SubElement(cell, "link", name="floor")
    for side, y in (("left", 0.35), ("right", -0.35)):
        stand = ElementTree.SubElement(cell, "joint", name=f"{side}_stand", type="fixed")
        ElementTree.SubElement(stand, "parent", link="floor")
        ElementTree.SubElement(stand, "child", link=f"{side}_base")
        ElementTree.SubElement(stand, "origin", xyz=f"0 {y} 0")
        for part in copy.deepcopy([*one.findall("link"), *one.findall("joint")]):
            for named, key in ((part, "name"), (part.find("parent"), "link"), (part.find("child"), "link")):
                if named is not None:
                    named.set(key, f"{side}_{named.get(key)}")
            cell.append(part)
    urdf = folder / "cell.urdf"
    urdf.write_bytes(ElementTree.tostring(cell))
    first = builtin_text("arm6").replace('"arm6.urdf"', f'"{urdf}"').replace('"tip"', '"left_tip"')
    axes = first[first.index("[[axis]]") :]
    second = re.sub(r"index = (\d)", lambda found: f"index = {int(found[1]) + 6}", axes)
    tool = first[first.index("[[tool]]") : first.index("[[axis]]")].replace("number = 1", "number = 2")
    tool = tool.replace("left_tip", "right_tip").replace("[0, 1, 2, 3, 4, 5]", "[6, 7, 8, 9, 10, 11]")
    return parse_machine("\n".join((first, tool, second, *more)))


def block(name: str, at_mm: tuple[float, ...], edge_mm: float) -> str:
    """A cube that stands still."""
    return f"""
[[body]]
name = "{name}"
shape = "box"
size_mm = [{edge_mm}, {edge_mm}, {edge_mm}]
at_mm = [{at_mm[0]}, {at_mm[1]}, {at_mm[2]}]
"""


def middle_of(scene: Scene, name: str, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the middle of a body of that name at these positions, shape (3,) [m]."""
    scene.place(positions)
    number = next(each for each, known in scene._names.items() if known == name)
    body = scene._geometry.geometryObjects[number]
    body.geometry.computeLocalAABB()
    return np.asarray(scene._placed.oMg[number].act(np.asarray(body.geometry.aabb_center)))
