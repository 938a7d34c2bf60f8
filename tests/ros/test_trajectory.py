"""Trajectories and tolerances of goals: what is refused, and where joints are on the way."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.ros.interfaces import interfaces
from mcserver.ros.joints import Joint
from mcserver.ros.outcome import INVALID_GOAL, INVALID_JOINTS, InvalidGoal
from mcserver.ros.stamps import duration_of
from mcserver.ros.tolerances import read_tolerances
from mcserver.ros.trajectory import MAX_POINTS, Motion, Trajectory, read_trajectory

A = Joint("a", 0, True, math.radians(1.0), -2.0, 2.0, 3.0, 1e-4)
B = Joint("b", 1, False, 1e-3, -math.inf, math.inf, 1.0, 1e-5)
KNOWN = {"a": A, "b": B}
FOLLOW = "control_msgs/action/FollowJointTrajectory"


def trajectory(names: list[str], *points: tuple[float, list[float]], **fields: list[list[float]]) -> Any:
    make = interfaces().make
    made = []
    for row, (time_s, positions) in enumerate(points):
        more = {name: np.array(values[row], np.float64) for name, values in fields.items()}
        made.append(
            make(
                "trajectory_msgs/msg/JointTrajectoryPoint",
                positions=np.array(positions, np.float64),
                time_from_start=duration_of(time_s),
                **more,
            )
        )
    return make("trajectory_msgs/msg/JointTrajectory", joint_names=names, points=made)


def read(*points: tuple[float, list[float]], names: list[str] | None = None, **fields: Any) -> Trajectory:
    return read_trajectory(trajectory(names or ["a", "b"], *points, **fields), KNOWN)


def motion(
    *points: tuple[float, list[float]], start: tuple[float, float] = (0.0, 0.0), **fields: Any
) -> Motion:
    return Motion(read(*points, **fields), 0.0, np.array(start), np.zeros(2))


@pytest.mark.parametrize(
    ("names", "code", "said"),
    [
        (["a", "c"], INVALID_JOINTS, "no joint 'c'"),
        (["a", "a"], INVALID_JOINTS, "named once"),
        ([], INVALID_JOINTS, "named once"),
    ],
)
def test_joints_have_to_be_there_once(names: list[str], code: int, said: str) -> None:
    with pytest.raises(InvalidGoal, match=said) as refused:
        read((1.0, [0.0] * len(names)), names=names) if names else read_trajectory(trajectory([]), KNOWN)
    assert refused.value.outcome.code == code


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([], "0 points"),
        ([(1.0, [0.0])], "of all 2 joints"),
        ([(1.0, [0.0, math.nan])], "not all finite"),
        ([(1.0, [math.inf, 0.0])], "not all finite"),
        ([(1.0, [0.1, 0.0]), (1.0, [0.2, 0.0])], "do not increase"),
        ([(2.0, [0.1, 0.0]), (1.0, [0.2, 0.0])], "do not increase"),
        ([(-1.0, [0.1, 0.0])], "do not increase"),
        ([(1.0, [2.5, 0.0])], "its travel is -2 to 2"),
        ([(4000.0, [0.0, 0.0])], "3600 s at most"),
        ([(1.0, [])], "no positions"),
    ],
)
def test_points_that_cannot_be_meant_are_refused(points: list[tuple[float, list[float]]], said: str) -> None:
    with pytest.raises(InvalidGoal, match=said) as refused:
        read(*points)
    assert refused.value.outcome.code == INVALID_GOAL


def test_more_points_than_are_possible_are_refused() -> None:
    with pytest.raises(InvalidGoal, match="10001 points"):
        read(*((0.1 * (at + 1), [0.0, 0.0]) for at in range(MAX_POINTS + 1)))


def test_a_last_point_that_is_passed_at_a_speed_is_refused() -> None:
    with pytest.raises(InvalidGoal, match="come to rest"):
        read((1.0, [0.1, 0.0]), velocities=[[0.1, 0.0]])


def test_more_speed_than_a_joint_has_is_refused() -> None:
    with pytest.raises(InvalidGoal, match=r"b would go at 1\.5 "):
        motion((1.0, [0.0, 1.0]))


def test_a_curve_that_swings_beyond_travel_is_refused() -> None:
    with pytest.raises(InvalidGoal, match="its travel"):
        motion((1.0, [1.9, 0.0]), (2.0, [1.9, 0.0]), velocities=[[2.9, 0.0], [0.0, 0.0]])


def test_a_trajectory_that_begins_at_once_begins_where_the_joints_are() -> None:
    with pytest.raises(InvalidGoal, match=r"begins at once with a at 0\.5, not at 0"):
        motion((0.0, [0.5, 0.0]), (1.0, [0.6, 0.0]))
    motion((0.0, [0.01, 0.0]), (1.0, [0.1, 0.0]))


def test_points_are_passed_at_their_times_and_the_end_is_kept() -> None:
    made = motion((1.0, [0.5, 0.1]), (2.0, [0.6, 0.2]), velocities=[[0.2, 0.1], [0.0, 0.0]])
    positions, velocities = made.at(np.array([0.0, 1.0, 2.0, 9.0]))
    assert positions.tolist() == pytest.approx(np.array([[0, 0], [0.5, 0.1], [0.6, 0.2], [0.6, 0.2]]))
    assert velocities.tolist() == pytest.approx(np.array([[0, 0], [0.2, 0.1], [0, 0], [0, 0]]))


def test_accelerations_make_the_way_a_quintic() -> None:
    fields = {"velocities": [[0.0, 0.0]], "accelerations": [[0.0, 0.0]]}
    positions, _ = motion((1.0, [1.0, 0.0]), **fields).at(np.array([0.25]))
    assert positions[0, 0] == pytest.approx(10 * 0.25**3 - 15 * 0.25**4 + 6 * 0.25**5)


def test_one_that_takes_over_goes_on_from_where_and_how_fast_the_joints_are() -> None:
    made = Motion(read((1.0, [0.5, 0.1])), 0.0, np.array([0.2, 0.0]), np.array([0.3, 0.0]))
    positions, velocities = made.at(np.array([1e-6]))
    assert positions[0].tolist() == pytest.approx([0.2, 0.0], abs=1e-5)
    assert velocities[0].tolist() == pytest.approx([0.3, 0.0], abs=1e-4)


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(0.01, 2.0)), min_size=1, max_size=20))
def test_positions_alone_are_joined_beyond_none_of_them(steps: list[tuple[float, float]]) -> None:
    times = np.cumsum([step for _, step in steps]) + 1.0
    points = [(float(at), [place, 0.0]) for at, (place, _) in zip(times, steps, strict=True)]
    quick = {"a": A._replace(max_velocity=1e9), "b": B}
    made = Motion(read_trajectory(trajectory(["a", "b"], *points), quick), 0.0, np.zeros(2), np.zeros(2))
    positions, _ = made.at(np.linspace(0.0, float(times[-1]), 500))
    places = [0.0, *(place for place, _ in steps)]
    assert min(places) - 1e-9 <= positions[:, 0].min() <= positions[:, 0].max() <= max(places) + 1e-9


def test_a_tolerance_of_zero_is_the_default_and_a_negative_one_none() -> None:
    make = interfaces().make
    given = [make("control_msgs/msg/JointTolerance", name="a", position=-1.0)]
    path = [make("control_msgs/msg/JointTolerance", name="b", position=0.2, velocity=0.5)]
    found = read_tolerances(make(f"{FOLLOW}_Goal", path_tolerance=path, goal_tolerance=given), [A, B])
    assert found.path.tolist() == [math.inf, 0.2]
    assert found.path_velocity.tolist() == [math.inf, 0.5]
    assert found.goal.tolist() == [math.inf, 1e-5]
    assert found.settle_s == 5.0
    assert found.violated_on_path(np.array([9.0, -0.3]), np.zeros(2)) == 1
    assert found.violated_on_path(np.array([9.0, 0.1]), np.zeros(2)) is None


@pytest.mark.parametrize(
    ("name", "value", "code"), [("c", 0.1, INVALID_JOINTS), ("a", math.nan, INVALID_GOAL)]
)
def test_tolerances_that_cannot_be_meant_are_refused(name: str, value: float, code: int) -> None:
    make = interfaces().make
    given = [make("control_msgs/msg/JointTolerance", name=name, position=value)]
    with pytest.raises(InvalidGoal) as refused:
        read_tolerances(make(f"{FOLLOW}_Goal", goal_tolerance=given), [A, B])
    assert refused.value.outcome.code == code
