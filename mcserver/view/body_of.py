"""The body of a machine: a robot if it has tools, else a portal of its linear axes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mckinematics.model import read_urdf
from mckinematics.solver import MachineKinematics

from mcserver.machine.machine_file import Machine
from mcserver.view.body import Body, NoBody
from mcserver.view.gantry import Gantry
from mcserver.view.meshes import load_mesh
from mcserver.view.robot import Robot
from mcserver.view.solids import Array
from mcserver.view.tracks import Track, portal_axes
from mcserver.view.urdf import read_tree

# half of the space that is drawn for a portal of which nothing is known yet [m]
REACH = 0.25


def body_of(
    machine: Machine,
    kinematics: MachineKinematics | None,
    tracks: Sequence[Track],
    start: Array,
    roots: Sequence[Path] = (),
) -> Body:
    """What is drawn of a machine.

    Args:
        tracks: where its tips go; a portal is made so large. start: shape (3,), where a portal's tip is [m].
        roots: folders in which packages of meshes are looked for.
    """
    if kinematics is not None and kinematics.tools and machine.urdf is not None:
        joints: dict[int, str] = {}
        for tool in kinematics.tools:
            chain = kinematics.tool(tool).chain
            joints.update(zip(chain.axes, chain.joint_names, strict=True))
        return Robot(read_tree(read_urdf(machine.urdf)), joints, Path(machine.urdf), load_mesh, roots)
    if not portal_axes(machine):
        return NoBody()
    points = np.concatenate([start[None], *(track.points for track in tracks)])
    low, high = points.min(axis=0), points.max(axis=0)
    if not tracks:
        low, high = low - REACH, high + REACH
    least = 0.3 * max(float((high - low).max()), 1e-3)
    narrow = np.maximum(0.5 * (least - (high - low)), 0.0)
    return Gantry(portal_axes(machine), low - narrow, high + narrow)
