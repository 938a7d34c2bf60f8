"""Single positions in plain numbers, held against the chain that evaluates many together."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mckinematics.single import small_turn, solve_two
from mckinematics.solver import MachineKinematics
from scipy.spatial.transform import Rotation

from tests.kinematics.tool_machines import Joint, X, Y, Z, built_in, chain_machine

MIXED = (
    Joint("revolute", "0.1 0 0.3", Z),
    Joint("prismatic", "0.2 0.1 0", X, -0.5, 0.5),
    Joint("continuous", "0 0.1 0", Y),
    Joint("prismatic", "0 0 -0.2", Z, -0.5, 0.5),
)
ANGLES = st.floats(-3.0, 3.0)


def _chains(folder: Path) -> list[MachineKinematics]:
    return [built_in("robot-dog")[1], built_in("arm6")[1], MachineKinematics(chain_machine(folder, MIXED))]


def test_single_positions_and_many_together_agree(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    for kinematics in _chains(tmp_path):
        chain = kinematics.tool(kinematics.tools[0]).chain
        joints = random.uniform(-2.0, 2.0, (20, chain.size))
        positions, rotations, jacobians = chain.jacobian(joints)
        for index, row in enumerate(joints.tolist()):
            single = chain.single.linearise(row)
            np.testing.assert_allclose(single.position, positions[index], atol=1e-14)
            np.testing.assert_allclose(single.rotation, rotations[index].ravel(), atol=1e-14)
            np.testing.assert_allclose(single.columns, jacobians[index].T, atol=1e-14)


def test_a_jacobian_of_the_point_alone_is_the_upper_half_of_the_whole(tmp_path: Path) -> None:
    for kinematics in _chains(tmp_path):
        chain = kinematics.tool(kinematics.tools[0]).chain
        joints = np.random.default_rng(6).uniform(-2.0, 2.0, (7, chain.size))
        np.testing.assert_array_equal(chain.jacobian(joints, 3)[2], chain.jacobian(joints)[2][:, :3])


@given(arrays(np.float64, (4, 4), elements=st.floats(-1.0, 1.0)), arrays(np.float64, (2, 4), elements=ANGLES))
def test_two_systems_are_solved_at_once(matrix: np.ndarray, right: np.ndarray) -> None:
    # diagonally dominant: far from singular
    matrix = matrix + 5.0 * np.eye(4)
    solved = solve_two(matrix.T.tolist(), right[0].tolist(), right[1].tolist())
    assert solved is not None
    np.testing.assert_allclose(matrix @ solved[0], right[0], atol=1e-12)
    np.testing.assert_allclose(matrix @ solved[1], right[1], atol=1e-12)


def test_rows_are_exchanged_where_a_pivot_is_zero() -> None:
    solved = solve_two([[0.0, 1.0], [2.0, 0.0]], [4.0, 3.0], [2.0, 1.0])
    assert solved == ([3.0, 2.0], [1.0, 1.0])


def test_a_singular_system_has_no_solution() -> None:
    assert solve_two([[1.0, 2.0], [2.0, 4.0]], [1.0, 1.0], [1.0, 1.0]) is None


@given(st.tuples(ANGLES, ANGLES, ANGLES), st.tuples(*[st.floats(-0.85, 0.85)] * 3))
def test_a_small_turn_is_the_rotation_vector(
    start: tuple[float, float, float], turn: tuple[float, float, float]
) -> None:
    before = Rotation.from_rotvec(start)
    after = Rotation.from_rotvec(turn) * before
    found = small_turn(after.as_matrix().ravel().tolist(), before.as_matrix().ravel().tolist())
    assert found is not None
    np.testing.assert_allclose(found, turn, atol=1e-12)


def test_a_turn_beyond_a_right_angle_is_not_small() -> None:
    quarter = Rotation.from_rotvec([0.0, 0.0, math.radians(91.0)]).as_matrix().ravel().tolist()
    assert small_turn(quarter, np.eye(3).ravel().tolist()) is None


@pytest.mark.parametrize("size", [1, 4096])
def test_forward_kinematics_gives_the_tip_with_all_joints_at_zero(size: int) -> None:
    chain = built_in("arm6")[1].tool(1).chain
    positions, rotations = chain.forward(np.zeros((size, 6)))
    np.testing.assert_allclose(positions, np.tile(chain.tip_position, (size, 1)), atol=1e-14)
    np.testing.assert_allclose(rotations, np.tile(chain.tip_rotation, (size, 1, 1)), atol=1e-14)
