"""A B C in every order of X, Y, Z (D-51)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mckinematics.pose import Triple
from mckinematics.rotation import euler_to_matrix, matrix_to_euler, rotation_matrices, rotation_vectors
from scipy.spatial.transform import Rotation

ORDERS = ("ZYX", "XYZ", "XZY", "YXZ", "YZX", "ZXY")
ANGLE = st.floats(-400.0, 400.0).map(math.radians)
TRIPLES = st.tuples(ANGLE, ANGLE, ANGLE)


@pytest.mark.parametrize("order", ORDERS)
@settings(max_examples=40)
@given(angles=TRIPLES)
def test_matrices_are_those_of_scipy(order: str, angles: Triple) -> None:
    # SciPy takes the angles in the order of the factors; A B C are always about X Y Z
    in_order = [angles["XYZ".index(letter)] for letter in order]
    expected = Rotation.from_euler(order, in_order).as_matrix()
    np.testing.assert_allclose(euler_to_matrix(angles, order), expected, atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
@settings(max_examples=40)
@given(angles=TRIPLES)
def test_the_angles_read_back_give_the_same_orientation(order: str, angles: Triple) -> None:
    matrix = euler_to_matrix(angles, order)
    np.testing.assert_allclose(euler_to_matrix(matrix_to_euler(matrix, order), order), matrix, atol=2e-7)


@pytest.mark.parametrize("order", ORDERS)
@settings(max_examples=40)
@given(angles=TRIPLES)
def test_the_triple_nearest_to_the_last_one_is_the_last_one(order: str, angles: Triple) -> None:
    middle = angles["XYZ".index(order[1])]
    if abs(math.cos(middle)) < 1e-3:
        return
    np.testing.assert_allclose(
        matrix_to_euler(euler_to_matrix(angles, order), order, near=angles), angles, atol=1e-9
    )


@pytest.mark.parametrize("order", ["ZYX", "XYZ"])
@pytest.mark.parametrize("b", [90.0, -90.0])
def test_c_keeps_its_value_at_gimbal_lock(order: str, b: float) -> None:
    angles = (math.radians(25.0), math.radians(b), math.radians(-70.0))
    read = matrix_to_euler(euler_to_matrix(angles, order), order, near=(0.0, 0.0, math.radians(-70.0)))
    np.testing.assert_allclose(read, angles, atol=1e-7)


@pytest.mark.parametrize("order", ORDERS)
def test_without_a_last_value_the_kept_angle_is_zero_at_gimbal_lock(order: str) -> None:
    angles = [0.3, 0.3, 0.3]
    angles["XYZ".index(order[1])] = math.pi / 2.0
    matrix = euler_to_matrix((angles[0], angles[1], angles[2]), order)
    read = matrix_to_euler(matrix, order)
    kept = 1 if order[1] == "Z" else 2
    assert read[kept] == 0.0
    np.testing.assert_allclose(euler_to_matrix(read, order), matrix, atol=1e-12)


def test_zyx_turns_about_x_first_and_about_z_last() -> None:
    quarter = math.pi / 2.0
    turned = euler_to_matrix((quarter, 0.0, quarter), "ZYX") @ np.array([0.0, 1.0, 0.0])
    np.testing.assert_allclose(turned, [0.0, 0.0, 1.0], atol=1e-15)


@settings(max_examples=60)
@given(
    axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1),
    angle=st.one_of(
        st.floats(0.0, math.pi), st.floats(0.0, 1e-6), st.floats(0.0, 1e-6).map(lambda e: math.pi - e)
    ),
)
def test_rotation_vectors_and_matrices_are_inverse(axis: Triple, angle: float) -> None:
    vector = np.asarray(axis) / np.linalg.norm(axis) * angle
    matrix = rotation_matrices(vector[None])
    np.testing.assert_allclose(matrix[0], Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rotation_matrices(rotation_vectors(matrix)), matrix, atol=1e-9)
    assert abs(np.linalg.norm(rotation_vectors(matrix)) - angle) < 1e-7


def test_a_half_turn_keeps_its_axis() -> None:
    axis = np.array([0.6, -0.0, 0.8])
    found = rotation_vectors(rotation_matrices((math.pi * axis)[None]))[0]
    np.testing.assert_allclose(np.abs(found), math.pi * np.abs(axis), atol=1e-7)
