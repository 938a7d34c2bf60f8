"""Poses of tools over many cycles."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from mckinematics.rotation import euler_to_matrix
from scipy.spatial.transform import Rotation

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.tool_poses import ToolPoses, matrices_to_euler

ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]


@pytest.mark.parametrize("order", ORDERS)
def test_angles_give_their_orientation_back_in_any_order(order: str) -> None:
    turns = Rotation.random(500, random_state=5).as_matrix()
    for angles, turn in zip(matrices_to_euler(turns, order), turns, strict=True):
        a, b, c = angles.tolist()
        np.testing.assert_allclose(euler_to_matrix((a, b, c), order), turn, atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_orientation_holds_at_gimbal_lock_too(order: str, sign: float) -> None:
    angles = [0.4, 0.7, -0.3]
    angles["XYZ".index(order[1])] = sign * np.pi / 2.0
    turn = euler_to_matrix((angles[0], angles[1], angles[2]), order)
    a, b, c = matrices_to_euler(turn[None], order, (0.1, 0.2, 0.3))[0].tolist()
    np.testing.assert_allclose(euler_to_matrix((a, b, c), order), turn, atol=1e-7)


def test_c_keeps_its_value_of_the_row_before_at_gimbal_lock() -> None:
    rows = [(0.2, 1.5, 0.9), (0.2, np.pi / 2.0, 0.9), (0.6, np.pi / 2.0, 1.3)]
    turns = np.array([euler_to_matrix(row, "ZYX") for row in rows])
    # at B = 90 deg only A - C is determined, and it is the same in the last two rows
    np.testing.assert_allclose(matrices_to_euler(turns, "ZYX")[1:], [rows[1], rows[1]], atol=1e-7)


def test_a_first_row_at_gimbal_lock_has_c_zero() -> None:
    turn = euler_to_matrix((0.2, np.pi / 2.0, 0.9), "ZYX")[None]
    np.testing.assert_allclose(matrices_to_euler(turn, "ZYX")[0], (-0.7, np.pi / 2.0, 0.0), atol=1e-7)


def test_poses_of_many_rows_are_those_of_each_row_alone() -> None:
    machine = load_machine("arm6")
    kinematics = build_kinematics(machine)
    assert kinematics is not None
    positions = np.random.default_rng(1).uniform(-1.0, 1.0, (5000, 6))
    poses = ToolPoses(machine, kinematics).of(1, positions)
    for row in (0, 4095, 4096, 4999):
        alone = kinematics.pose(1, dict(enumerate(positions[row].tolist())))
        np.testing.assert_allclose(poses[row, :3], np.multiply(alone.position, 1000.0), atol=1e-9)
        np.testing.assert_allclose(poses[row, 3:], np.degrees(alone.angles), atol=1e-9)


def test_a_machine_without_tools_has_no_poses() -> None:
    assert ToolPoses(load_machine("cartesian"), None).numbers == ()
