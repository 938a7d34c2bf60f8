"""Compute the commanded pose of a tool (D-50, D-51)."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mckinematics.pose import Kinematics, Pose, Triple

from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.machine.machine_file import Machine

GIMBAL = 1e-6  # cosine of the middle angle below which the outer two axes coincide


def commanded_pose(kinematics: Kinematics, tool: int, machine: Machine, commanded: CommandedState) -> Pose:
    """Return the tool's last commanded pose, or FK if its joints were moved directly since.

    Raises:
        KinematicsError: the model has no such pose.
    """
    kept = commanded.poses.get(tool)
    if kept is not None and tool not in commanded.stale:
        return kept
    pose = kinematics.pose(tool, commanded.positions)
    if kept is not None and kinematics.has_orientation(tool):
        euler = next((each.euler for each in machine.tools if each.number == tool), "ZYX")
        pose = Pose(pose.position, keep_c(pose.angles, kept.angles[2], euler))
    commanded.poses[tool] = pose
    commanded.stale.discard(tool)
    return pose


def keep_c(angles: Triple, c: float, euler: str) -> Triple:
    """Keep C in the same orientation if the Euler angles do not determine it (B = ±90°, D-51).

    With the middle factor at ±90° the outer factors turn about one axis: R = R1(a)·R2(±90°)·R3(b) depends on
    a ± b alone. The sign is that of the order's permutation times that of the middle angle.

    Args:
        angles: A, B, C about X, Y, Z [rad].
        c: the value to keep [rad].
        euler: order of the factors from left to right, such as ``ZYX``.
    """
    first, middle, last = ("XYZ".index(letter) for letter in euler)
    if abs(math.cos(angles[middle])) > GIMBAL or middle == 2:
        return angles
    even = euler in ("XYZ", "YZX", "ZXY")
    sign = math.copysign(1.0, math.sin(angles[middle])) * (1.0 if even else -1.0)
    other = last if first == 2 else first
    kept = [angles[0], angles[1], angles[2]]
    kept[other] = angles[other] + sign * (angles[2] - c)
    kept[2] = c
    return (kept[0], kept[1], kept[2])


def start_pose(kinematics: Kinematics, tool: int, commanded: CommandedState, pose: Pose) -> Pose:
    """Return the start of the tool's path: the commanded pose, or FK if a joint was stopped early (D-25)."""
    if commanded.starts.keys().isdisjoint(kinematics.axes(tool)):
        return pose
    return kinematics.pose(tool, commanded.path_starts())


def with_words(pose: Pose, values: Mapping[int, float]) -> Pose:
    """Replace some of the six coordinates of a pose [m and rad]."""
    x, y, z = (values.get(index, pose.position[index]) for index in range(3))
    a, b, c = (values.get(index + 3, pose.angles[index]) for index in range(3))
    return Pose((x, y, z), (a, b, c))
