"""Short lines on which all joints of a tool go evenly, and where they must not."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mckinematics.even_path import EvenPaths
from mckinematics.pose import Triple
from mckinematics.solver import MachineKinematics

from tests.kinematics import arm7
from tests.kinematics.test_other_chains import PLANAR
from tests.kinematics.tool_machines import built_in, chain_machine

MACHINE, ARM, START = built_in("arm6")
HOME = ARM.pose(1, START)


def even(
    travel: Triple,
    turn: Triple = (0.0, 0.0, 0.0),
    *,
    arm: MachineKinematics = ARM,
    joints: dict[int, float] = START,
) -> EvenPaths | None:
    pose = arm.pose(1, joints)
    end, angles = np.add(pose.position, travel), np.add(pose.angles, turn).tolist()
    found = arm.solve_even_paths(1, np.array((pose.position, end)), np.array((pose.angles, angles)), joints)
    return found if len(found) else None


def test_a_short_line_ends_at_its_pose_and_stays_near_on_the_way() -> None:
    travel, turn = (0.002, -0.001, 0.0015), (0.004, -0.003, 0.002)
    found = even(travel, turn)
    assert found is not None
    end = ARM.pose(1, dict(enumerate(found.joints[1])))
    np.testing.assert_allclose(end.position, np.add(HOME.position, travel), atol=2e-8)
    np.testing.assert_allclose(end.angles, np.add(HOME.angles, turn), atol=2e-8)
    start = np.array([START[axis] for axis in range(6)])
    poses = [
        (share, ARM.pose(1, dict(enumerate(start + share * (found.joints[1] - start)))))
        for share in np.linspace(0.0, 1.0, 41)
    ]
    off = max(
        math.dist(pose.position, np.add(HOME.position, share * np.array(travel))) for share, pose in poses
    )
    assert off == pytest.approx(found.off[0], rel=0.02)
    assert 0.0 < found.off[0] < 1e-4
    assert 0.0 < found.off_angle[0] < 1e-3
    assert found.fastest[0] == pytest.approx(math.hypot(*travel), rel=0.01)
    assert found.rates.shape == (1, 2, 6, 6)
    np.testing.assert_allclose(found.rates[0, 0], ARM.jacobians(1, start[None])[0], atol=1e-12)


def test_joints_do_not_go_wild_past_a_singular_wrist() -> None:
    # two axes of the wrist are in line: half a turn of the one and back of the other lets the tip stay
    straight = {**START, 4: math.radians(0.01)}
    assert even((1e-5, 1e-5, 0.0), joints=straight) is None


def test_a_short_step_that_does_not_close_the_gap_is_no_end(tmp_path: Path) -> None:
    # the elbow is stretched: Newton's damped step is far below its bound and leaves 6 µm of 50 µm
    start = dict(enumerate(np.radians((80.0, 50.0, 10.0, 0.0, 50.0, 60.0, 10.0)).tolist()))
    assert even((5e-5, 0.0, 0.0), arm=MachineKinematics(arm7.machine(tmp_path)), joints=start) is None


def test_a_line_past_a_limit_is_left_to_the_path_solver() -> None:
    low, high = MACHINE.axes[0].min_position, MACHINE.axes[0].max_position
    for limit, side in ((high, 1.0), (low, -1.0)):
        at_limit = {**START, 0: limit - side * 1e-5}
        x, y, _ = ARM.pose(1, at_limit).position
        across = np.array([-y, x, 0.0]) / math.hypot(x, y) * 1e-3 * side
        assert (
            even(tuple(across.tolist()), (0.0, 0.0, side * 1e-3 / math.hypot(x, y)), joints=at_limit) is None
        )


def test_no_line_begins_away_from_the_joints() -> None:
    away = np.add(HOME.position, (0.001, 0.0, 0.0))
    assert not len(ARM.solve_even_paths(1, np.array((away, away)), np.array((HOME.angles,) * 2), START))


def test_lines_in_a_row_are_those_found_one_by_one_and_end_before_the_first_that_fails() -> None:
    steps = [(0.0, 0.0, 0.0), *[(1e-3, -5e-4, 2e-4)] * 7, (0.9, 0.0, 0.0), (1e-3, 0.0, 0.0)]
    points = HOME.position + np.cumsum(steps, axis=0)
    angles = HOME.angles + np.linspace(0.0, 0.05, len(points))[:, None] * (1.0, -0.5, 0.3)
    found = ARM.solve_even_paths(1, points, angles, START)
    assert len(found) == 7
    joints = START
    for index in range(len(found)):
        at = slice(index, index + 2)
        single = ARM.solve_even_paths(1, points[at], angles[at], joints)
        for name in ("fastest", "rates", "off", "off_angle"):
            np.testing.assert_allclose(getattr(found, name)[index], getattr(single, name)[0], atol=1e-12)
        np.testing.assert_allclose(found.joints[index + 1], single.joints[1], atol=1e-12)
        joints = dict(enumerate(single.joints[1]))


def test_a_chain_with_a_joint_to_spare_goes_evenly_too(tmp_path: Path) -> None:
    start = dict(enumerate(np.radians(arm7.START)))
    arm = MachineKinematics(arm7.machine(tmp_path))
    found = even((0.001, 0.0, -0.001), arm=arm, joints=start)
    assert found is not None
    goal = np.add(arm.pose(1, start).position, (0.001, 0.0, -0.001))
    np.testing.assert_allclose(arm.pose(1, dict(enumerate(found.joints[1]))).position, goal, atol=2e-8)


def test_a_chain_with_too_few_joints_is_left_to_the_path_solver(tmp_path: Path) -> None:
    planar = MachineKinematics(chain_machine(tmp_path, PLANAR))
    assert even((0.0, 0.001, 0.0), arm=planar, joints={0: 0.5, 1: 1.0}) is None
