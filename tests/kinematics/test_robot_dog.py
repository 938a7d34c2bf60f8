"""The robot dog: its geometry in closed form, its start, and the reference's gait."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mckinematics.pose import Pose, ToolPath

from tests.kinematics.tool_machines import built_in, leg
from tests.kinematics.tool_paths import circle, ends_at, joints_at, line

HIPS = {3: (-0.099, 0.400), 6: (0.099, 0.400), 9: (-0.099, -0.450), 12: (0.099, -0.450)}
STARTS = {3: (-0.159, 0.0), 6: (0.159, 0.8), 9: (-0.159, -0.1), 12: (0.159, -0.8)}
GROUND = -0.4


def foot(tool: int, hip: float, thigh: float, knee: float) -> tuple[float, float, float]:
    """The foot in closed form, from the leg's dimensions alone [m]."""
    x, z = HIPS[tool]
    side = math.copysign(0.060, x)
    down = -0.350 * math.cos(thigh) - 0.350 * math.cos(thigh + knee)
    along = -0.350 * math.sin(thigh) - 0.350 * math.sin(thigh + knee)
    return (
        x + side * math.cos(hip) - down * math.sin(hip),
        side * math.sin(hip) + down * math.cos(hip),
        z + along,
    )


def stance(tool: int, start: float, end: float) -> ToolPath:
    """A straight stroke on the ground along Z."""
    x = STARTS[tool][0]
    return line((x, GROUND, start), (x, GROUND, end))


def swing(tool: int, start: float, end: float) -> ToolPath:
    """G02 in {Y, Z} with R500, seen from +X: up over the ground and back along -Z."""
    half = (start - end) / 2.0
    below = math.sqrt(0.25 - half * half)
    centre = (STARTS[tool][0], GROUND - below, (start + end) / 2.0)
    first = np.array([0.0, below, half])
    # from the start the foot rises: a quarter on it would be at centre + (Y half, Z -below)
    return circle(centre, first, (0.0, half, -below), 2.0 * math.atan2(half, below))


GAIT = (
    {3: stance(3, 0.0, 0.8), 12: stance(12, -0.8, -0.1), 6: swing(6, 0.8, 0.0), 9: swing(9, -0.1, -0.8)},
    {6: stance(6, 0.0, 0.8), 9: stance(9, -0.8, -0.1), 3: swing(3, 0.8, 0.0), 12: swing(12, -0.1, -0.8)},
)


@pytest.mark.parametrize("tool", HIPS)
def test_forward_kinematics_are_the_closed_form(tool: int) -> None:
    _, kinematics, joints = built_in("robot-dog")
    for hip, thigh, knee in np.random.default_rng(tool).uniform(
        (-0.7, -2.6, -2.8), (0.7, 2.6, -0.3), (20, 3)
    ):
        named = joints | dict(zip(kinematics.axes(tool), (hip, thigh, knee), strict=True))
        np.testing.assert_allclose(
            kinematics.pose(tool, named).position, foot(tool, hip, thigh, knee), atol=1e-14
        )


@pytest.mark.parametrize("tool", HIPS)
def test_each_foot_starts_where_the_gait_is_periodic(tool: int) -> None:
    _, kinematics, joints = built_in("robot-dog")
    x, z = STARTS[tool]
    np.testing.assert_allclose(kinematics.pose(tool, joints).position, (x, GROUND, z), atol=1e-12)


def test_each_tool_has_three_axes_of_its_own() -> None:
    _, kinematics, _ = built_in("robot-dog")
    assert {tool: kinematics.axes(tool) for tool in kinematics.tools} == {
        3: (0, 1, 2),
        6: (3, 4, 5),
        9: (6, 7, 8),
        12: (9, 10, 11),
    }
    assert not any(kinematics.has_orientation(tool) for tool in kinematics.tools)


def test_the_joint_path_starts_exactly_at_the_joints_and_ends_exactly_at_the_target() -> None:
    _, kinematics, joints = built_in("robot-dog")
    path = kinematics.solve_path(3, GAIT[0][3], joints)
    assert (joints_at(path, np.zeros(1))[0] == leg(kinematics, 3, joints)).all()
    np.testing.assert_allclose(kinematics.pose(3, ends_at(path)).position, (-0.159, GROUND, 0.8), atol=1e-12)


def test_velocity_and_acceleration_are_continuous_along_the_path() -> None:
    _, kinematics, joints = built_in("robot-dog")
    path = kinematics.solve_path(6, GAIT[0][6], joints)
    width = np.diff(path.knots)[:-1, None]
    cubic, square, linear, _ = path.coefficients[:, :-1]
    np.testing.assert_allclose(
        (3.0 * cubic * width + 2.0 * square) * width + linear, path.coefficients[2, 1:], atol=1e-9
    )
    np.testing.assert_allclose(3.0 * cubic * width + square, path.coefficients[1, 1:], atol=1e-7)


def test_the_slope_at_both_ends_is_that_of_the_foot() -> None:
    _, kinematics, joints = built_in("robot-dog")
    path = kinematics.solve_path(6, GAIT[0][6], joints)
    chain = kinematics.tool(6).chain
    for s in (0.0, 1.0):
        at = np.array([s])
        step = 1e-6 if s == 0.0 else -1e-6
        slope = (joints_at(path, at + step) - joints_at(path, at)) / step
        jacobian = chain.jacobian(joints_at(path, at))[2][0, :3]
        np.testing.assert_allclose(jacobian @ slope[0], GAIT[0][6].derivative(at)[0], atol=1e-4)


def test_the_gait_stays_far_from_singular() -> None:
    _, kinematics, joints = built_in("robot-dog")
    for tool, wanted in GAIT[0].items():
        path = kinematics.solve_path(tool, wanted, joints)
        jacobians = kinematics.tool(tool).chain.jacobian(joints_at(path, np.linspace(0.0, 1.0, 101)))[2][
            :, :3
        ]
        assert np.linalg.svd(jacobians, compute_uv=False).min() > 0.178


def test_the_limits_leave_the_gait_in_one_second_a_margin() -> None:
    # a profile of one second at rest on both ends has a speed of 2, an acceleration of 8 and a jerk of 32 at
    # most (per unit of s) when half of it is spent on ramps of constant jerk
    machine, kinematics, joints = built_in("robot-dog")
    for stroke in GAIT:
        for tool, wanted in stroke.items():
            path = kinematics.solve_path(tool, wanted, joints)
            joints = joints | ends_at(path)
            third, second, first = np.abs(path.coefficients[:3]).max(axis=1)
            for column, axis in enumerate(path.axes):
                limits = machine.axis(axis)
                assert limits is not None
                speed, bend, twist = first[column], 2.0 * second[column], 6.0 * third[column]
                assert 2.0 * speed < 0.7 * limits.max_velocity
                assert 4.0 * bend + 8.0 * speed < 0.7 * limits.max_acceleration
                assert 8.0 * twist + 48.0 * bend + 32.0 * speed < 0.7 * limits.max_jerk


def test_the_home_position_holds_the_foot_below_the_hip() -> None:
    _, kinematics, joints = built_in("robot-dog")
    home = kinematics.solve_pose(3, Pose((-0.159, -0.4, 0.4)), joints)
    np.testing.assert_allclose(np.degrees(home), (0.0, 55.15, -110.3), atol=0.01)
