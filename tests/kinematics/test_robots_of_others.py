"""Real robots' URDFs, from the package example-robot-data, each from a machine file of its own.

Points and orientations are checked by a walk along the URDF's joints that shares nothing with the product.
"""

from __future__ import annotations

import importlib.metadata
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mckinematics.pose import ToolPath, Triple
from mckinematics.solver import MachineKinematics
from scipy.spatial.transform import Rotation

from mcserver.machine.machine_file import load_machine
from tests.golden.urdf_tips import tips_of
from tests.kinematics.tool_machines import machine_text
from tests.kinematics.tool_paths import circle, ends_at, joints_at, line

PACKAGE = "example-robot-data"


def _robots() -> Path | None:
    try:
        distribution = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        return None
    return Path(str(distribution.locate_file("cmeel.prefix/share/example-robot-data/robots")))


ROBOTS = _robots()
pytestmark = pytest.mark.skipif(ROBOTS is None, reason=f"{PACKAGE} is not installed")


@dataclass(frozen=True)
class Robot:
    """A robot of a machine file, and its URDF's text."""

    kinematics: MachineKinematics
    urdf: str
    frames: Sequence[str]

    def follow(self, tool: int, wanted: ToolPath, joints: dict[int, float]) -> dict[int, float]:
        """Follows a path, holds it against the URDF at 800 places, and gives the joints at its end."""
        path = self.kinematics.solve_path(tool, wanted, joints)
        s = np.linspace(0.0, 1.0, 801)
        points, turns = tips_of(self.urdf, self.frames[tool - 1], joints_at(path, s))
        assert np.linalg.norm(points - wanted.position(s), axis=1).max() < 1e-5
        if wanted.start_angles is not None and wanted.end_angles is not None:
            order = self.kinematics.tool(tool).euler
            first, last = (_rotation(angles, order) for angles in (wanted.start_angles, wanted.end_angles))
            ideal = Rotation.from_rotvec(s[:, None] * (last * first.inv()).as_rotvec()) * first
            assert (turns * ideal.inv()).magnitude().max() < math.radians(0.01)
        return joints | ends_at(path)


def _rotation(angles: Triple, order: str) -> Rotation:
    return Rotation.from_euler(order, [angles["XYZ".index(letter)] for letter in order])


def _robot(folder: Path, urdf: str, frames: Sequence[str], joints: int, *, euler: str | None) -> Robot:
    """``euler`` None: tools without orientation; each tool has its share of ``joints``."""
    share = joints // len(frames)
    tools = [
        f'frame = "{frame}"\naxes = {list(range(number * share, (number + 1) * share))}\n'
        f'orientation = {str(euler is not None).lower()}\neuler = "{euler or "ZYX"}"'
        for number, frame in enumerate(frames)
    ]
    (folder / "robot.urdf").write_text(urdf, "utf-8")
    (folder / "robot.toml").write_text(machine_text("robot.urdf", tools, joints), "utf-8")
    return Robot(MachineKinematics(load_machine(str(folder / "robot.toml"))), urdf, frames)


def _text(urdf: str) -> str:
    assert ROBOTS is not None
    return (ROBOTS / urdf).read_text("utf-8")


def _follow(robot: Robot, tool: int, joints: dict[int, float], moved: Triple) -> dict[int, float]:
    """A line and then a circle; the joints at the end."""
    kinematics = robot.kinematics
    pose = kinematics.pose(tool, joints)
    a, b, c = pose.angles
    oriented = kinematics.has_orientation(tool)
    end = np.asarray(pose.position) + moved
    angles = ((a, b, c), (a + 0.1, b - 0.1, c + 0.2)) if oriented else (None, None)
    joints = robot.follow(tool, line(pose.position, end, *angles), joints)
    held = kinematics.pose(tool, joints).angles if oriented else None
    wanted = circle(end - (0.03, 0.0, 0.0), (0.03, 0.0, 0.0), (0.0, 0.0, 0.03), math.tau, held, held)
    return robot.follow(tool, wanted, joints)


def test_a_ur5_follows_lines_and_circles(tmp_path: Path) -> None:
    robot = _robot(tmp_path, _text("ur_description/urdf/ur5_robot.urdf"), ["tool0"], 6, euler="ZYX")
    joints = dict(enumerate((0.3, -1.2, 1.6, -1.8, -1.4, 0.2)))
    again = _follow(robot, 1, joints, (0.1, 0.15, -0.1))
    np.testing.assert_allclose(
        robot.kinematics.pose(1, again).position,
        np.add(robot.kinematics.pose(1, joints).position, (0.1, 0.15, -0.1)),
        atol=1e-9,
    )


def test_a_panda_follows_lines_and_circles_with_a_fixed_finger(tmp_path: Path) -> None:
    # seven joints and a gripper that is no axis: its fingers are made fast
    text = _text("panda_description/urdf/panda.urdf")
    for finger in ("panda_finger_joint1", "panda_finger_joint2"):
        text = text.replace(f'name="{finger}" type="prismatic"', f'name="{finger}" type="fixed"')
    assert 'type="prismatic"' not in text
    robot = _robot(tmp_path, text, ["panda_leftfinger"], 7, euler="XYZ")
    _follow(robot, 1, dict(enumerate((0.1, -0.4, 0.1, -2.0, 0.1, 1.7, 0.6))), (0.1, 0.1, -0.1))


def test_the_legs_of_a_solo12_follow_lines_and_circles(tmp_path: Path) -> None:
    feet = ["FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"]
    robot = _robot(tmp_path, _text("solo_description/robots/solo12.urdf"), feet, 12, euler=None)
    front, hind = (0.1, 0.8, -1.6), (-0.1, -0.8, 1.6)
    joints = dict(enumerate((*front, *front, *hind, *hind)))
    for tool in (1, 2, 3, 4):
        _follow(robot, tool, joints, (0.04, 0.01, 0.02))


def test_a_kinova_with_endless_joints_follows_lines_and_circles(tmp_path: Path) -> None:
    urdf = _text("kinova_description/robots/kinova.urdf")
    robot = _robot(tmp_path, urdf, ["j2s6s200_end_effector"], 6, euler="ZYX")
    _follow(robot, 1, dict(enumerate((4.7, 2.8, 1.6, 4.2, 1.4, 1.3))), (0.05, 0.05, -0.05))
