"""Real robots' URDFs, from the package example-robot-data where it is installed."""

from __future__ import annotations

import importlib.metadata
import math
from pathlib import Path

import numpy as np
import pytest

from kinematics.pose import Triple
from kinematics.solver import MachineKinematics
from mcserver.config import parse_machine
from tests.kinematics.tool_machines import machine_text
from tests.kinematics.tool_paths import circle, ends_at, largest_error, line

PACKAGE = "example-robot-data"


def _robots() -> Path | None:
    try:
        distribution = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        return None
    return Path(str(distribution.locate_file("cmeel.prefix/share/example-robot-data/robots")))


ROBOTS = _robots()
pytestmark = pytest.mark.skipif(ROBOTS is None, reason=f"{PACKAGE} is not installed")


def _kinematics(urdf: str, tools: list[str], axes: int) -> MachineKinematics:
    assert ROBOTS is not None
    return MachineKinematics(parse_machine(machine_text(str(ROBOTS / urdf), tools, axes)))


def _tool(frame: str, axes: range, orientation: bool, euler: str = "ZYX") -> str:
    return (
        f'frame = "{frame}"\naxes = {list(axes)}\norientation = {str(orientation).lower()}\neuler = "{euler}"'
    )


def _follow(
    kinematics: MachineKinematics, tool: int, joints: dict[int, float], moved: Triple
) -> dict[int, float]:
    """A line and then a circle; the joints at the end."""
    pose = kinematics.pose(tool, joints)
    a, b, c = pose.angles
    oriented = kinematics.has_orientation(tool)
    end = np.asarray(pose.position) + moved
    wanted = line(
        pose.position, end, *(((a, b, c), (a + 0.1, b - 0.1, c + 0.2)) if oriented else (None, None))
    )
    path = kinematics.solve_path(tool, wanted, joints)
    assert largest_error(kinematics, tool, wanted, path) < 1e-5
    joints = joints | ends_at(path)
    held = kinematics.pose(tool, joints).angles if oriented else None
    wanted = circle(end - (0.03, 0.0, 0.0), (0.03, 0.0, 0.0), (0.0, 0.0, 0.03), math.tau, held, held)
    path = kinematics.solve_path(tool, wanted, joints)
    assert largest_error(kinematics, tool, wanted, path) < 1e-5
    return joints | ends_at(path)


def test_a_ur5_follows_lines_and_circles() -> None:
    kinematics = _kinematics("ur_description/urdf/ur5_robot.urdf", [_tool("tool0", range(6), True)], 6)
    joints = dict(enumerate((0.3, -1.2, 1.6, -1.8, -1.4, 0.2)))
    again = _follow(kinematics, 1, joints, (0.1, 0.15, -0.1))
    np.testing.assert_allclose(
        kinematics.pose(1, again).position,
        np.add(kinematics.pose(1, joints).position, (0.1, 0.15, -0.1)),
        atol=1e-9,
    )


def test_a_panda_with_seven_joints_follows_lines_and_circles() -> None:
    kinematics = _kinematics(
        "panda_description/urdf/panda.urdf", [_tool("panda_hand", range(7), True, "XYZ")], 7
    )
    _follow(kinematics, 1, dict(enumerate((0.1, -0.4, 0.1, -2.0, 0.1, 1.7, 0.6))), (0.1, 0.1, -0.1))


def test_two_legs_of_a_solo12_follow_lines_and_circles() -> None:
    tools = [_tool("FL_FOOT", range(3), False), _tool("HR_FOOT", range(3, 6), False)]
    kinematics = _kinematics("solo_description/robots/solo12.urdf", tools, 6)
    joints = dict(enumerate((0.1, 0.8, -1.6, -0.1, -0.8, 1.6)))
    for tool in (1, 2):
        _follow(kinematics, tool, joints, (0.04, 0.01, 0.02))


def test_a_kinova_with_endless_joints_follows_lines_and_circles() -> None:
    kinematics = _kinematics(
        "kinova_description/robots/kinova.urdf", [_tool("j2s6s200_end_effector", range(6), True)], 6
    )
    _follow(kinematics, 1, dict(enumerate((4.7, 2.8, 1.6, 4.2, 1.4, 1.3))), (0.05, 0.05, -0.05))
