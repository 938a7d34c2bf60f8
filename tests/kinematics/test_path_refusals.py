"""Every fault of a tool path, by a case which earns it (D-53)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mckinematics.errors import BranchJump, JointLimit, ModelError, Singular, Unreachable
from mckinematics.pose import Pose
from mckinematics.solver import MachineKinematics

from tests.kinematics.tool_machines import Joint, X, Y, Z, built_in, chain_machine
from tests.kinematics.tool_paths import circle, follow, joints_at, line

# a leg of 400 + 300 mm in the plane X Y, on a slide along Z
LEG = (
    Joint("prismatic", "0 0 0", Z, -1.0, 1.0),
    Joint("revolute", "0 0 0", Z, -3.0, 3.0),
    Joint("revolute", "0.4 0 0", Z, -0.1, 2.8),
)
BENT = {0: 0.0, 1: 0.2, 2: 1.0}


@pytest.fixture
def leg(tmp_path: Path) -> MachineKinematics:
    return MachineKinematics(chain_machine(tmp_path, LEG))


def test_a_line_out_of_reach_tells_how_much_is_missing(leg: MachineKinematics) -> None:
    start = leg.pose(1, BENT).position
    with pytest.raises(Unreachable) as caught:
        leg.solve_path(1, line(start, (1.0, 0.0, 0.0)), BENT)
    error = caught.value
    assert error.code == "MC302"
    assert error.tool == 1
    # the arm of 700 mm against a target 1000 mm away
    assert error.residual == pytest.approx(0.3, abs=1e-6)
    assert "300 mm are missing" in error.message


def test_a_line_out_of_reach_tells_where_it_leaves_the_reach(leg: MachineKinematics) -> None:
    start = np.asarray(leg.pose(1, BENT).position)
    with pytest.raises(Unreachable) as caught:
        leg.solve_path(1, line(start, (1.0, 0.0, 0.0)), BENT)
    error = caught.value
    assert error.s is not None
    assert error.position is not None
    np.testing.assert_allclose(
        error.position, start + error.s * (np.array([1.0, 0.0, 0.0]) - start), atol=1e-12
    )
    assert np.linalg.norm(error.position) == pytest.approx(0.7, abs=1e-3)


def test_a_path_whose_middle_alone_is_out_of_reach_is_refused(leg: MachineKinematics) -> None:
    # both ends are on the circle of 650 mm, the middle of the bulge is 50 mm beyond the reach
    reach = 0.65
    joints = dict(enumerate(leg.solve_pose(1, Pose((reach, 0.0, 0.0)), BENT)))
    bulge = circle((reach, 0.1, 0.0), (0.0, -0.1, 0.0), (0.1, 0.0, 0.0), math.pi)
    with pytest.raises(Unreachable) as caught:
        leg.solve_path(1, bulge, joints)
    assert caught.value.residual == pytest.approx(math.hypot(reach + 0.1, 0.1) - 0.7, abs=3e-3)


def test_a_joint_past_its_limit_is_named_with_value_and_limit(leg: MachineKinematics) -> None:
    start = leg.pose(1, BENT).position
    with pytest.raises(JointLimit) as caught:
        leg.solve_path(1, line(start, (start[0], start[1], 1.25)), BENT)
    error = caught.value
    assert error.code == "MC303"
    assert error.axis == 0
    assert error.value == pytest.approx(1.25, abs=1e-6)
    assert "joint 'joint0'" in error.message
    assert "1250 mm" in error.message
    assert "upper limit is 1000 mm" in error.message
    assert error.residual == pytest.approx(0.25, abs=1e-6)


def test_a_limit_that_is_passed_only_on_the_way_is_found(leg: MachineKinematics) -> None:
    start = np.asarray(leg.pose(1, BENT).position)
    top = circle(np.add(start, (0.0, 0.0, 0.95)), (0.0, 0.0, -0.95), (0.05, 0.0, 0.0), math.tau)
    with pytest.raises(JointLimit) as caught:
        leg.solve_path(1, top, BENT)
    assert caught.value.axis == 0
    assert caught.value.value == pytest.approx(1.9, abs=1e-4)
    assert caught.value.s == pytest.approx(math.acos(-0.05 / 0.95) / math.tau, abs=0.01)


def test_the_limits_of_the_machine_file_count_where_they_are_narrower(tmp_path: Path) -> None:
    narrow = MachineKinematics(chain_machine(tmp_path, LEG, limits={0: (-100.0, 100.0)}))
    start = narrow.pose(1, BENT).position
    with pytest.raises(JointLimit, match="upper limit is 100 mm"):
        narrow.solve_path(1, line(start, (start[0], start[1], 0.2)), BENT)


def test_a_path_that_starts_past_a_limit_is_refused(leg: MachineKinematics) -> None:
    joints = {**BENT, 0: 1.2}
    start = leg.pose(1, joints).position
    with pytest.raises(JointLimit) as caught:
        leg.solve_path(1, line(start, (start[0], start[1], 1.1)), joints)
    assert caught.value.s == 0.0


def test_a_path_to_the_straight_leg_is_singular(leg: MachineKinematics) -> None:
    start = leg.pose(1, BENT).position
    with pytest.raises(Singular) as caught:
        leg.solve_path(1, line(start, (0.7, 0.0, 0.0)), BENT)
    assert caught.value.code == "MC304"
    assert caught.value.s == pytest.approx(1.0, abs=0.01)


def test_a_start_with_the_leg_straight_is_singular_at_once(leg: MachineKinematics) -> None:
    joints = {0: 0.0, 1: 0.0, 2: 0.0}
    with pytest.raises(Singular) as caught:
        leg.solve_path(1, line((0.7, 0.0, 0.0), (0.5, 0.1, 0.0)), joints)
    assert caught.value.s == 0.0


@pytest.mark.parametrize("missing", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 0.0])
def test_nearly_straight_legs_are_passed_exactly_or_refused(leg: MachineKinematics, missing: float) -> None:
    wanted = line(leg.pose(1, BENT).position, (0.7 - missing, 0.0, 0.0))
    if missing < 2e-7:
        with pytest.raises(Singular):
            leg.solve_path(1, wanted, BENT)
        return
    path = follow(leg, 1, wanted, BENT)
    knee = joints_at(path, np.linspace(0.0, 1.0, 2001))[:, 2]
    # the knee bends while the line comes nearer, then opens, and never goes beyond straight
    assert np.count_nonzero(np.diff(np.sign(np.diff(knee)))) == 1
    assert knee.min() > 0.0


def test_a_slide_past_the_straight_leg_is_no_matter_while_the_knee_is_bent(leg: MachineKinematics) -> None:
    start = leg.pose(1, BENT).position
    wanted = line(start, (start[0], start[1], 0.9))
    follow(leg, 1, wanted, BENT)


def test_a_wrist_passes_its_singular_position_where_nothing_turns_about_the_lost_direction() -> None:
    # with all joints at zero the arm's axes 4 and 6 align; a line in the arm's own plane needs neither
    _, arm, _ = built_in("arm6")
    joints = dict.fromkeys(range(6), 0.0)
    pose = arm.pose(1, joints)
    x, y, z = pose.position
    wanted = line(pose.position, (x - 0.1, y, z - 0.1), pose.angles, pose.angles)
    path = follow(arm, 1, wanted, joints)
    np.testing.assert_allclose(path.coefficients[:, :, [0, 3, 5]], 0.0, atol=1e-6)


def test_a_wrist_in_its_singular_position_refuses_the_lost_direction() -> None:
    _, arm, _ = built_in("arm6")
    joints = dict.fromkeys(range(6), 0.0)
    pose = arm.pose(1, joints)
    x, y, z = pose.position
    with pytest.raises(Singular):
        arm.solve_path(1, line(pose.position, (x, y + 0.1, z), pose.angles, pose.angles), joints)


# Wenger's 3R arm with axes at right angles: inside its reach, places of two and of four configurations
CUSPIDAL = (
    Joint("continuous", "0 0 0", Z),
    Joint("continuous", "0.1 0 0", Y),
    Joint("continuous", "0.2 0.1 0", Z),
)
CUSPIDAL_TIP = "0.15 0 0"


def _degrees(*values: float) -> dict[int, float]:
    return dict(enumerate(math.radians(value) for value in values))


def test_a_path_out_of_its_configuration_has_no_continuous_joint_path(tmp_path: Path) -> None:
    arm = MachineKinematics(chain_machine(tmp_path, CUSPIDAL, tip=CUSPIDAL_TIP))
    joints = _degrees(60.0, 23.0, 44.0)
    end = (-0.016, 0.056, 0.114)
    with pytest.raises(BranchJump) as caught:
        arm.solve_path(1, line(arm.pose(1, joints).position, end), joints)
    error = caught.value
    assert error.code == "MC305"
    assert error.s is not None
    assert 0.7 < error.s < 0.76
    assert "start from the other configuration" in error.hint


def test_the_same_path_is_passed_in_another_configuration(tmp_path: Path) -> None:
    arm = MachineKinematics(chain_machine(tmp_path, CUSPIDAL, tip=CUSPIDAL_TIP))
    start = arm.pose(1, _degrees(60.0, 23.0, 44.0))
    joints = dict(enumerate(arm.solve_pose(1, start, _degrees(77.5, 20.2, -8.0))))
    wanted = line(start.position, (-0.016, 0.056, 0.114))
    follow(arm, 1, wanted, joints)


def test_every_point_of_a_path_without_a_joint_path_can_be_reached(tmp_path: Path) -> None:
    arm = MachineKinematics(chain_machine(tmp_path, CUSPIDAL, tip=CUSPIDAL_TIP))
    joints = _degrees(60.0, 23.0, 44.0)
    start, end = np.asarray(arm.pose(1, joints).position), np.array([-0.016, 0.056, 0.114])
    for share in np.linspace(0.0, 1.0, 21):
        x, y, z = (start + share * (end - start)).tolist()
        reached = dict(enumerate(arm.solve_pose(1, Pose((x, y, z)), joints)))
        np.testing.assert_allclose(arm.pose(1, reached).position, (x, y, z), atol=1e-9)


def test_a_path_through_the_axis_of_a_turntable_needs_its_slide_past_its_limit(tmp_path: Path) -> None:
    # X on a slide that cannot pass the middle: beyond it the table would have to jump half a turn
    polar = (Joint("continuous", "0 0 0", Z), Joint("prismatic", "0.001 0 0", X, 0.0, 0.5))
    kinematics = MachineKinematics(chain_machine(tmp_path, polar, tip="0 0 0"))
    joints = {0: 0.0, 1: 0.2}
    with pytest.raises(JointLimit) as caught:
        kinematics.solve_path(1, line((0.201, 0.0, 0.0), (-0.201, 0.0, 0.0)), joints)
    assert caught.value.axis == 1


def test_joints_that_are_not_at_the_start_of_the_path_are_refused(leg: MachineKinematics) -> None:
    x, y, z = leg.pose(1, BENT).position
    with pytest.raises(ModelError, match=r"0\.01 mm") as caught:
        leg.solve_path(1, line((x, y, z + 1e-5), (x, y, z + 0.1)), BENT)
    assert caught.value.residual == pytest.approx(1e-5)


def test_rounding_at_the_start_of_the_path_is_no_fault_and_no_jump(leg: MachineKinematics) -> None:
    x, y, z = leg.pose(1, BENT).position
    path = leg.solve_path(1, line((x, y, z + 5e-7), (x, y, z + 0.1)), BENT)
    assert (joints_at(path, np.zeros(1))[0] == list(BENT.values())).all()
    assert np.abs(path.coefficients[1, :, 0]).max() < 1e-6


def test_a_pose_out_of_reach_tells_the_distance(leg: MachineKinematics) -> None:
    with pytest.raises(Unreachable) as caught:
        leg.solve_pose(1, Pose((0.0, 1.5, 0.0)), BENT)
    assert caught.value.residual == pytest.approx(0.8, abs=1e-6)
    assert caught.value.s is None
    assert caught.value.position == (0.0, 1.5, 0.0)


def test_a_pose_past_a_limit_names_the_joint(leg: MachineKinematics) -> None:
    with pytest.raises(JointLimit) as caught:
        leg.solve_pose(1, Pose((0.3, 0.3, -1.4)), BENT)
    assert caught.value.axis == 0
    assert caught.value.value == pytest.approx(-1.4, abs=1e-9)
    assert caught.value.residual == pytest.approx(0.4, abs=1e-6)


def test_an_orientation_out_of_reach_tells_the_angle(tmp_path: Path) -> None:
    scara = (
        Joint("revolute", "0 0 0.3", Z),
        Joint("revolute", "0.4 0 0", Z),
        Joint("prismatic", "0.3 0 0", Z, -0.2, 0.2),
        Joint("continuous", "0 0 0", Z),
    )
    kinematics = MachineKinematics(chain_machine(tmp_path, scara, tip="0 0 -0.1", orientation=True))
    joints = {0: 0.5, 1: 1.0, 2: 0.0, 3: 0.2}
    pose = kinematics.pose(1, joints)
    with pytest.raises(Unreachable, match="5 deg are missing") as caught:
        kinematics.solve_pose(1, Pose(pose.position, (math.radians(5.0), 0.0, 0.0)), joints)
    assert caught.value.residual == pytest.approx(0.0, abs=1e-4)


def test_a_pose_out_of_reach_with_orientation_tells_the_distance_with_that_orientation() -> None:
    _, arm, start = built_in("arm6")
    # straight down, 300 mm over the table: the wrist is to be 1500 mm from the middle of the base
    with pytest.raises(Unreachable) as caught:
        arm.solve_pose(1, Pose((1.5, 0.0, 0.2), (0.0, 0.0, 0.0)), start)
    shoulder, wrist = np.array([0.03, 0.38]), np.array([1.5, 0.38])
    reach = 0.44 + math.hypot(0.43, 0.035)
    assert caught.value.residual == pytest.approx(np.linalg.norm(wrist - shoulder) - reach, abs=1e-4)


def test_a_path_without_orientation_for_a_tool_that_has_one_is_refused() -> None:
    _, arm, start = built_in("arm6")
    home = arm.pose(1, start).position
    with pytest.raises(ModelError, match="no orientation"):
        arm.solve_path(1, line(home, home), start)


def test_messages_are_in_millimetres_and_degrees() -> None:
    _, dog, start = built_in("robot-dog")
    with pytest.raises(JointLimit, match=r"axis 2 .* at -\d+(\.\d+)? deg; its upper limit is -15 deg"):
        dog.solve_path(3, line((-0.159, -0.4, 0.0), (-0.159, -0.569, 0.0)), start)
