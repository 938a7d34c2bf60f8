"""Seven joints for six numbers of a pose: a posture says what becomes of the one to spare."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mckinematics.errors import ModelError, Singular, Unreachable
from mckinematics.pose import Array, Pose
from mckinematics.solver import MachineKinematics

from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import load_machine
from tests.kinematics import arm7
from tests.kinematics.tool_paths import follow, joints_at, line

START = dict(enumerate(np.radians(arm7.START)))
AWAY = "posture = [-40, 35, 50, 70, -30, 45, 20]"
SHARES = np.linspace(0.0, 1.0, 301)


def arm(folder: Path, keys: str = "") -> MachineKinematics:
    return MachineKinematics(arm7.machine(folder, tools=(keys,)))


def distance(joints: Array | tuple[float, ...], keys: str) -> float:
    """How far joints are from a posture [rad]."""
    wanted = np.radians([float(each) for each in keys[keys.index("[") + 1 : keys.index("]")].split(",")])
    return float(np.linalg.norm(np.asarray(joints) - wanted))


def test_a_target_is_taken_in_the_posture_nearest_to_the_one_preferred(tmp_path: Path) -> None:
    plain, preferring = arm(tmp_path), arm(tmp_path, AWAY)
    pose = plain.pose(1, START)
    target = Pose((pose.position[0] - 0.1, pose.position[1] + 0.15, pose.position[2]), pose.angles)
    least, found = plain.solve_pose(1, target, START), preferring.solve_pose(1, target, START)
    assert distance(found, AWAY) < distance(least, AWAY) - 0.1
    np.testing.assert_allclose(
        preferring.pose(1, dict(enumerate(found))).position, target.position, atol=1e-8
    )
    # where the joints come from makes no difference to where they end
    other = preferring.solve_pose(1, target, dict(enumerate(least)))
    np.testing.assert_allclose(other, found, atol=2e-3)


def test_a_line_moves_the_spare_joint_towards_the_posture_and_keeps_the_tool_on_it(tmp_path: Path) -> None:
    plain, preferring = arm(tmp_path), arm(tmp_path, AWAY)
    pose = plain.pose(1, START)
    turned = (pose.angles[0], pose.angles[1] + 0.2, pose.angles[2])
    wanted = line(pose.position, np.add(pose.position, (0.05, -0.3, -0.1)), pose.angles, turned)
    path = follow(preferring, 1, wanted, START)
    along, least = joints_at(path, SHARES), joints_at(plain.solve_path(1, wanted, START), SHARES)
    end = Pose(tuple(np.add(pose.position, (0.05, -0.3, -0.1))), turned)
    best = preferring.solve_pose(1, end, dict(enumerate(along[-1])))
    assert np.linalg.norm(along[-1] - best) < 0.8 * np.linalg.norm(least[-1] - best)
    chain = preferring.tool(1).chain
    assert (along >= chain.lower).all()
    assert (along <= chain.upper).all()
    # continuous, without a turn of a joint that the tool does not ask for
    assert np.abs(np.diff(along, axis=0)).max() < 0.02


def test_a_posture_makes_a_loop_come_back_to_the_same_joints(tmp_path: Path) -> None:
    def drift(keys: str) -> float:
        """How far the joints are from where they were a loop before, after some loops [rad]."""
        kinematics = arm(tmp_path, keys)
        joints = dict(START)
        pose = kinematics.pose(1, joints)
        corners = [np.add(pose.position, each) for each in ((0, 0, 0), (0.2, 0.2, 0), (-0.2, 0.2, -0.1))]
        before = joints
        for _ in range(8):
            before = dict(joints)
            for begin, end in zip(corners, [*corners[1:], corners[0]], strict=True):
                angles = (pose.angles, pose.angles)
                path = kinematics.solve_path(1, line(tuple(begin), tuple(end), *angles), joints)
                joints = dict(enumerate(joints_at(path, np.array([1.0]))[0]))
        return float(np.linalg.norm(np.subtract(list(joints.values()), list(before.values()))))

    assert drift("posture = [0, 30, 0, 70, 0, 40, 0]") < 0.25 * drift("")


def test_a_stretched_arm_is_refused_with_the_place(tmp_path: Path) -> None:
    kinematics = arm(tmp_path, AWAY)
    straight = {**START, 1: 0.5, 3: 0.0, 5: 0.3}
    pose = kinematics.pose(1, straight)
    wanted = line(pose.position, np.add(pose.position, (-0.2, 0.0, -0.2)), pose.angles, pose.angles)
    with pytest.raises(Singular, match="singular at X"):
        kinematics.solve_path(1, wanted, straight)


@pytest.mark.parametrize("point", [(-1.86, -0.18, -1.0), (1.08, 0.63, 0.21), (0.8, -0.49, 1.46)])
def test_a_point_out_of_reach_is_refused_with_what_is_missing(
    tmp_path: Path, point: tuple[float, float, float]
) -> None:
    kinematics = arm(tmp_path)
    for angles in ((-0.73, -0.54, -0.32), (-0.31, 1.46, 1.96), (-1.32, -0.66, 0.94)):
        with pytest.raises(Unreachable, match="mm are missing") as refused:
            kinematics.solve_pose(1, Pose(point, angles), START)
        assert refused.value.residual is not None


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("posture = [0, 30]", "one position for each axis"),
        ("posture = [0, 30, 0, 70, 0, 140, 0]", "axis 5 at 140 deg, outside"),
    ],
)
def test_a_posture_that_the_arm_cannot_take_is_refused(tmp_path: Path, keys: str, message: str) -> None:
    with pytest.raises((ConfigurationError, ModelError), match=message):
        arm(tmp_path, keys)


def test_a_posture_of_joints_that_a_pose_determines_is_refused(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, tools=("posture = [0, 30, 0, 70, 0, 40, 0]",))
    text = (tmp_path / "arm7.toml").read_text()
    assert machine.tools[0].posture == pytest.approx(tuple(math.radians(each) for each in arm7.START))
    six = text.replace('frame = "tip"', 'frame = "link_6"').replace("4, 5, 6]\n", "4, 5]\n")
    six = six.replace("70, 0, 40, 0]", "70, 0, 40]")
    (tmp_path / "six.toml").write_text(six)
    with pytest.raises(ModelError, match="none of its 6 joints is to spare"):
        MachineKinematics(load_machine(str(tmp_path / "six.toml")))
