"""The six-axis arm: lines, circles and turns of its tip, and single poses from far away."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from mckinematics.errors import KinematicsError
from mckinematics.pose import JointPath, Pose, ToolPath, Triple
from scipy.spatial.transform import Rotation

from tests.kinematics.tool_machines import built_in
from tests.kinematics.tool_paths import circle, ends_at, follow, joints_at, largest_error, line, tool_angles

MACHINE, ARM, START = built_in("arm6")
HOME = ARM.pose(1, START)
LIMITS = [(axis.min_position, axis.max_position) for axis in MACHINE.axes]
JOINTS = st.tuples(*[st.floats(low, high) for low, high in LIMITS])


def _rotation(angles: Triple) -> Rotation:
    return Rotation.from_euler("ZYX", angles[::-1])


def _largest_turn_error(wanted: ToolPath, joint_path: JointPath) -> float:
    """Largest angle between the tip and the single turn in proportion to s (D-51) [rad]."""
    assert wanted.start_angles is not None
    assert wanted.end_angles is not None
    s = np.linspace(0.0, 1.0, 101)
    first, last = _rotation(wanted.start_angles), _rotation(wanted.end_angles)
    turn = (last * first.inv()).as_rotvec()
    expected = Rotation.from_rotvec(s[:, None] * turn) * first
    found = Rotation.from_euler("ZYX", [angles[::-1] for angles in tool_angles(ARM, 1, joint_path, s)])
    return float((found * expected.inv()).magnitude().max())


def test_the_arm_starts_with_its_tool_straight_down() -> None:
    np.testing.assert_allclose(HOME.position, (0.460, 0.0, 0.675), atol=1e-12)
    np.testing.assert_allclose(HOME.angles, (0.0, 0.0, 0.0), atol=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_a_line_with_a_turn_keeps_point_and_orientation(seed: int) -> None:
    random = np.random.default_rng(seed)
    end = np.array([0.45, 0.0, 0.45]) + random.uniform(-0.15, 0.15, 3)
    a, b, c = random.uniform(-0.6, 0.6, 3)
    wanted = line(HOME.position, end, HOME.angles, (a, b, c))
    path = follow(ARM, 1, wanted, START)
    assert _largest_turn_error(wanted, path) < math.radians(0.01)


def test_a_circle_with_the_orientation_kept_closes() -> None:
    wanted = circle(
        (0.40, 0.0, 0.675), (0.06, 0.0, 0.0), (0.0, 0.06, 0.0), math.tau, HOME.angles, HOME.angles
    )
    path = follow(ARM, 1, wanted, START)
    np.testing.assert_allclose([ends_at(path)[axis] for axis in range(6)], list(START.values()), atol=1e-9)


def test_a_turn_on_the_spot_holds_the_point() -> None:
    wanted = line(HOME.position, HOME.position, HOME.angles, (0.5, -0.3, 0.8))
    path = follow(ARM, 1, wanted, START)
    assert _largest_turn_error(wanted, path) < math.radians(0.01)


def test_the_orientation_goes_the_short_way() -> None:
    # 350 degrees of C are a turn of 10 degrees the other way
    assert ARM.rotation_angle(1, (0.0, 0.0, 0.0), (0.0, 0.0, math.radians(350.0))) == pytest.approx(
        math.radians(10.0), abs=1e-12
    )
    wanted = line(HOME.position, HOME.position, HOME.angles, (0.0, 0.0, math.radians(350.0)))
    turned = ends_at(ARM.solve_path(1, wanted, START))[5] - START[5]
    assert abs(abs(turned) - math.radians(10.0)) < 1e-9


def test_a_path_without_travel_stands_still() -> None:
    path = ARM.solve_path(1, line(HOME.position, HOME.position, HOME.angles, HOME.angles), START)
    np.testing.assert_allclose(
        joints_at(path, np.linspace(0.0, 1.0, 11)), [list(START.values())] * 11, atol=1e-12
    )


@settings(max_examples=30)
@given(joints=JOINTS)
@example(joints=(0.0, 0.0, 0.0, 1.0, 1.2e-7, 1.0))  # beside a singular wrist
def test_a_pose_that_the_arm_can_do_is_found_again(joints: tuple[float, ...]) -> None:
    pose = ARM.pose(1, dict(enumerate(joints)))
    found = dict(enumerate(ARM.solve_pose(1, pose, START)))
    again = ARM.pose(1, found)
    np.testing.assert_allclose(again.position, pose.position, atol=1e-7)
    assert ARM.rotation_angle(1, pose.angles, again.angles) < 1e-6
    assert all(low - 1e-9 <= found[axis] <= high + 1e-9 for axis, (low, high) in enumerate(LIMITS))


@settings(max_examples=20)
@given(joints=JOINTS, moves=st.tuples(*[st.floats(-0.05, 0.05)] * 6))
def test_the_solution_is_no_further_than_one_that_is_known(
    joints: tuple[float, ...], moves: tuple[float, ...]
) -> None:
    near = [
        min(max(value + move, low), high)
        for value, move, (low, high) in zip(joints, moves, LIMITS, strict=True)
    ]
    pose = ARM.pose(1, dict(enumerate(joints)))
    jacobian = ARM.tool(1).chain.jacobian(np.array([joints]))[2][0]
    # where the arm is singular, solutions are not apart from each other
    assume(np.linalg.svd(jacobian, compute_uv=False).min() > 1e-3)
    found = ARM.solve_pose(1, pose, dict(enumerate(near)))
    assert math.dist(found, near) <= math.dist(joints, near) + 1e-4


def test_solving_is_deterministic() -> None:
    pose = Pose((0.3, 0.3, 0.3), (0.4, 0.2, 2.0))
    assert ARM.solve_pose(1, pose, START) == ARM.solve_pose(1, pose, START)


def test_every_refusal_is_typed() -> None:
    random = np.random.default_rng(8)
    refused: list[KinematicsError] = []
    for _ in range(20):
        a, b, c = random.uniform(-2.0, 2.0, 3)
        end = np.asarray(HOME.position) + random.uniform(-0.5, 0.5, 3)
        wanted = line(HOME.position, end, HOME.angles, (a, b, c))
        try:
            path = ARM.solve_path(1, wanted, START)
        except KinematicsError as error:
            refused.append(error)
        else:
            assert largest_error(ARM, 1, wanted, path) < 1e-5
    assert 0 < len(refused) < 20
    assert {error.code for error in refused} <= {"MC302", "MC303", "MC304", "MC305"}
    assert all(error.tool == 1 and error.s is not None and error.hint for error in refused)
