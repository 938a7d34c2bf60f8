"""Machines with fewer joints than a pose has numbers, with more, with slides, and with endless joints."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mckinematics.errors import Unreachable
from mckinematics.pose import Pose
from mckinematics.solver import MachineKinematics

from tests.kinematics.tool_machines import Joint, X, Y, Z, chain_machine
from tests.kinematics.tool_paths import circle, ends_at, follow, joints_at, largest_error, line

PLANAR = (Joint("revolute", "0 0 0", Z), Joint("revolute", "0.4 0 0", Z))
PLANAR_3 = (*PLANAR, Joint("continuous", "0.4 0 0", Z))
SCARA = (
    Joint("revolute", "0 0 0.3", Z, -2.5, 2.5),
    Joint("revolute", "0.4 0 0", Z, -2.5, 2.5),
    Joint("prismatic", "0.3 0 0", "0 0 -1", 0.0, 0.2),
    Joint("continuous", "0 0 0", Z),
)
GANTRY = (
    Joint("prismatic", "0 0 0", X, -1.0, 1.0),
    Joint("prismatic", "0 0 0", Y, -1.0, 1.0),
    Joint("prismatic", "0 0 0", Z, -0.5, 0.5),
)
FIVE_AXES = (*GANTRY, Joint("continuous", "0 0 0", Z), Joint("revolute", "0 0 0", Y, -2.0, 2.0))
SEVEN = (
    Joint("revolute", "0 0 0.3", Z, -2.8, 2.8),
    Joint("revolute", "0 0 0", Y, -1.7, 1.7),
    Joint("revolute", "0 0 0.3", Z, -2.8, 2.8),
    Joint("revolute", "0.05 0 0", Y, -0.1, 3.0),
    Joint("revolute", "-0.05 0 0.35", Z, -2.8, 2.8),
    Joint("revolute", "0 0 0", Y, -0.1, 3.0),
    Joint("revolute", "0.08 0 0", Z, -2.8, 2.8),
)
SEVEN_BENT = dict(enumerate((0.2, 0.4, -0.3, 1.4, 0.2, 1.2, 0.1)))


def test_two_joints_follow_a_line_in_their_plane(tmp_path: Path) -> None:
    planar = MachineKinematics(chain_machine(tmp_path, PLANAR))
    joints = {0: 0.5, 1: 1.0}
    start = np.asarray(planar.pose(1, joints).position)
    wanted = line(start, np.add(start, (-0.1, 0.1, 0.0)))
    follow(planar, 1, wanted, joints)


def test_two_joints_refuse_what_leaves_their_plane(tmp_path: Path) -> None:
    planar = MachineKinematics(chain_machine(tmp_path, PLANAR))
    joints = {0: 0.5, 1: 1.0}
    start = np.asarray(planar.pose(1, joints).position)
    with pytest.raises(Unreachable) as caught:
        planar.solve_path(1, line(start, np.add(start, (-0.1, 0.1, 0.02))), joints)
    assert caught.value.residual == pytest.approx(0.02, abs=1e-6)
    assert "2 directions only" in caught.value.hint


def test_two_joints_take_a_target_that_was_rounded_when_it_was_typed(tmp_path: Path) -> None:
    planar = MachineKinematics(chain_machine(tmp_path, PLANAR))
    joints = {0: 0.5, 1: 1.0}
    start = np.asarray(planar.pose(1, joints).position)
    wanted = line(start, np.add(start, (-0.1, 0.1, 2e-6)))
    follow(planar, 1, wanted, joints)


def test_three_joints_in_one_plane_follow_a_circle_in_it(tmp_path: Path) -> None:
    planar = MachineKinematics(chain_machine(tmp_path, PLANAR_3))
    joints = {0: 0.3, 1: 0.9, 2: 0.8}
    start = np.asarray(planar.pose(1, joints).position)
    wanted = circle(start - (0.05, 0.0, 0.0), (0.05, 0.0, 0.0), (0.0, 0.05, 0.0), math.tau)
    follow(planar, 1, wanted, joints)


def test_a_turntable_follows_its_own_circle(tmp_path: Path) -> None:
    table = MachineKinematics(chain_machine(tmp_path, [Joint("continuous", "0 0 0", Z)]))
    wanted = circle((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.3, 0.0), 3.0 * math.tau)
    path = table.solve_path(1, wanted, {0: 0.0})
    assert largest_error(table, 1, wanted, path) < 1e-5
    assert ends_at(path)[0] == pytest.approx(3.0 * math.tau, abs=1e-9)


def test_a_scara_moves_and_turns_about_z(tmp_path: Path) -> None:
    scara = MachineKinematics(chain_machine(tmp_path, SCARA, tip="0 0 -0.1", orientation=True))
    joints = {0: 0.5, 1: 1.0, 2: 0.1, 3: 5.0}
    pose = scara.pose(1, joints)
    end = np.add(pose.position, (-0.1, 0.1, -0.05))
    a, b, c = pose.angles
    wanted = line(pose.position, end, pose.angles, (a, b, c + 1.0))
    path = follow(scara, 1, wanted, joints)
    assert scara.rotation_angle(1, scara.pose(1, ends_at(path)).angles, (a, b, c + 1.0)) < 1e-8


def test_five_axes_follow_a_tilt_that_they_can_do(tmp_path: Path) -> None:
    machine = chain_machine(tmp_path, FIVE_AXES, tip="0 0 -0.1", orientation=True)
    kinematics = MachineKinematics(machine)
    joints = {0: 0.0, 1: 0.0, 2: 0.0, 3: 0.4, 4: 0.2}
    pose = kinematics.pose(1, joints)
    a, b, c = pose.angles
    wanted = line(pose.position, np.add(pose.position, (0.1, 0.2, 0.3)), pose.angles, (a, b + 0.5, c))
    path = follow(kinematics, 1, wanted, joints)
    assert ends_at(path)[4] == pytest.approx(0.7, abs=1e-9)


def test_a_gantry_moves_as_it_is_commanded(tmp_path: Path) -> None:
    gantry = MachineKinematics(chain_machine(tmp_path, GANTRY, tip="0 0 0", offset="[0.0, 0.0, -120.0]"))
    joints = dict.fromkeys(range(3), 0.0)
    path = gantry.solve_path(1, line((0.0, 0.0, -0.12), (0.3, -0.2, 0.1)), joints)
    np.testing.assert_allclose(joints_at(path, np.array([0.5]))[0], (0.15, -0.1, 0.11), atol=1e-12)


def test_an_endless_joint_goes_on_from_the_turn_it_is_in(tmp_path: Path) -> None:
    scara = MachineKinematics(chain_machine(tmp_path, SCARA, tip="0 0 -0.1", orientation=True))
    joints = {0: 0.5, 1: 1.0, 2: 0.1, 3: 10.0 * math.tau}
    pose = scara.pose(1, joints)
    found = scara.solve_pose(
        1, Pose(pose.position, (pose.angles[0], pose.angles[1], pose.angles[2] + 0.2)), joints
    )
    assert found[3] == pytest.approx(10.0 * math.tau + 0.2, abs=1e-6)


def test_a_limited_joint_takes_the_turn_that_its_limits_allow(tmp_path: Path) -> None:
    wide = (Joint("revolute", "0 0 0", Z, -6.0, 2.0),)
    table = MachineKinematics(chain_machine(tmp_path, wide))
    # straight on would be 2.5 rad, past the limit; the same place is at 2.5 - 2 pi
    found = table.solve_pose(1, Pose((0.3 * math.cos(2.5), 0.3 * math.sin(2.5), 0.0)), {0: 1.9})
    assert found[0] == pytest.approx(2.5 - math.tau, abs=1e-9)


@pytest.mark.parametrize("orientation", [False, True])
def test_seven_joints_follow_a_line_smoothly(tmp_path: Path, orientation: bool) -> None:
    arm = MachineKinematics(chain_machine(tmp_path, SEVEN, tip="0 0 0.1", orientation=orientation))
    pose = arm.pose(1, SEVEN_BENT)
    angles = (
        (pose.angles, (pose.angles[0] + 0.2, pose.angles[1], pose.angles[2])) if orientation else (None, None)
    )
    wanted = line(pose.position, np.add(pose.position, (0.05, -0.1, 0.08)), *angles)
    path = follow(arm, 1, wanted, SEVEN_BENT)
    # no joint makes detours: its way is hardly longer than the distance of its ends
    along = joints_at(path, np.linspace(0.0, 1.0, 501))
    detour = np.abs(np.diff(along, axis=0)).sum(axis=0) - np.abs(along[-1] - along[0])
    assert detour.max() < 0.05


def test_seven_joints_move_as_little_as_the_line_asks(tmp_path: Path) -> None:
    arm = MachineKinematics(chain_machine(tmp_path, SEVEN, tip="0 0 0.1"))
    start = np.asarray(arm.pose(1, SEVEN_BENT).position)
    path = arm.solve_path(1, line(start, np.add(start, (0.0, 0.05, 0.0))), SEVEN_BENT)
    joints = np.array(list(SEVEN_BENT.values()))
    jacobian = arm.tool(1).chain.jacobian(joints[None])[2][0, :3]
    np.testing.assert_allclose(
        path.coefficients[2, 0], np.linalg.pinv(jacobian) @ (0.0, 0.05, 0.0), atol=1e-9
    )


def test_a_joint_to_spare_moves_another_one_away_from_its_limit(tmp_path: Path) -> None:
    # the least motion would take joint 2 past its limit of 86 degrees; the others can do its part
    spare = (*PLANAR, Joint("revolute", "0.3 0 0", Z, -0.5, 1.5), Joint("prismatic", "0 0 0", Z, -1.0, 1.0))
    arm = MachineKinematics(chain_machine(tmp_path, spare))
    joints = {0: 0.2, 1: 0.9, 2: 1.4, 3: 0.0}
    start = np.asarray(arm.pose(1, joints).position)
    end = np.add(start, (-0.2, -0.1, 0.1))
    wanted = line(start, end)
    free = MachineKinematics(chain_machine(tmp_path, (*spare[:2], Joint("revolute", "0.3 0 0", Z), spare[3])))
    least = joints_at(free.solve_path(1, wanted, joints), np.linspace(0.0, 1.0, 501))
    assert least[:, 2].max() > 1.51
    path = follow(arm, 1, wanted, joints)
    assert joints_at(path, np.linspace(0.0, 1.0, 501))[:, 2].max() <= 1.5 + 1e-9


@pytest.mark.parametrize(
    ("joints", "orientation", "tip"),
    [
        (PLANAR, False, "0.3 0 0"),
        (PLANAR_3, False, "0.3 0 0"),
        (SCARA, True, "0 0 -0.1"),
        (GANTRY, False, "0 0 0"),
        (FIVE_AXES, True, "0 0 -0.1"),
        (SEVEN, True, "0 0 0.1"),
    ],
    ids=["planar", "planar-3", "scara", "gantry", "five-axes", "seven"],
)
def test_a_pose_that_a_chain_can_do_is_found_again(
    tmp_path_factory: pytest.TempPathFactory, joints: tuple[Joint, ...], orientation: bool, tip: str
) -> None:
    folder = tmp_path_factory.mktemp("chain")
    kinematics = MachineKinematics(chain_machine(folder, joints, tip=tip, orientation=orientation))
    low = [joint.lower for joint in joints]
    high = [joint.upper for joint in joints]
    middle = {axis: 0.5 * (low[axis] + high[axis]) + 0.1 for axis in range(len(joints))}

    @settings(max_examples=12)
    @given(shares=st.tuples(*[st.floats(0.0, 1.0)] * len(joints)))
    def found_again(shares: tuple[float, ...]) -> None:
        wanted = {axis: low[axis] + share * (high[axis] - low[axis]) for axis, share in enumerate(shares)}
        pose = kinematics.pose(1, wanted)
        found = dict(enumerate(kinematics.solve_pose(1, pose, middle)))
        again = kinematics.pose(1, found)
        np.testing.assert_allclose(again.position, pose.position, atol=5.1e-6)
        if orientation:
            assert kinematics.rotation_angle(1, pose.angles, again.angles) < math.radians(0.0051)

    found_again()
