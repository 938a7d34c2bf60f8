"""Frames of machines on the well-known channels."""

from __future__ import annotations

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from mcserver.foxglove.motion import joint_states, moving_frames, standing_frames
from mcserver.foxglove.scene import ZONE_ALPHA, path_clouds, scene_update
from mcserver.foxglove.shape import PORTAL, WORLD, Shape, shape_of
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.tool_poses import ToolPoses
from tests.clearance.machines import VISE, mill
from tests.foxglove.frames import Frames

CUBE = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
CARRIED = '\n[[body]]\nname = "{name}"\nshape = "sphere"\nradius_mm = 5.0\ncarried_by = [0]\n{more}'
DOOR = '\n[[zone]]\nname = "door"\nsize_mm = [10.0, 20.0, 30.0]\nat_mm = [100.0, 0.0, 0.0]\n'


def shape_and_frames(machine: Machine, positions: np.ndarray) -> tuple[Shape, list[Frames]]:
    """A machine's shape, and its frames at each row of positions [SI]."""
    shape = shape_of(machine, build_kinematics(machine), CUBE)
    standing = standing_frames(shape, 1)
    moving = moving_frames(shape, list(range(len(positions))), positions)
    return shape, [Frames(standing, each) for each in moving]


@pytest.mark.parametrize("name", ["robot-dog", "arm6"])
def test_frames_of_tips_are_where_the_kinematics_has_them(name: str) -> None:
    machine = load_machine(name)
    positions = np.random.default_rng(1).uniform(-1.2, 1.2, (20, len(machine.axes)))
    shape, frames = shape_and_frames(machine, positions)
    poses = ToolPoses(machine, build_kinematics(machine))
    for tool in poses.numbers:
        tips = [each.pose(f"T{tool}", shape.tree.root)[:3, 3] * 1e3 for each in frames]
        np.testing.assert_allclose(tips, poses.of(tool, positions)[:, :3], atol=1e-6)


def test_a_robot_stands_on_its_feet_in_the_world() -> None:
    machine = load_machine("robot-dog")
    shape, (frames,) = shape_and_frames(machine, np.zeros((1, len(machine.axes))))
    body = frames.pose(shape.tree.root, WORLD)[2, 3]
    assert all(frames.pose(f"T{tool.number}", WORLD)[2, 3] < body - 0.1 for tool in machine.tools)


def test_the_quill_of_a_machine_without_a_urdf_is_where_its_axes_are() -> None:
    machine = load_machine("cartesian")
    positions = np.zeros((1, len(machine.axes)))
    positions[0, :3] = 0.1, -0.2, 0.3
    _, (frames,) = shape_and_frames(machine, positions)
    np.testing.assert_allclose(frames.pose("Z", PORTAL)[:3, 3], [0.1, -0.2, 0.3], atol=1e-12)
    np.testing.assert_allclose(frames.pose("X", PORTAL)[:3, 3], [0.1, -0.2, 0.0], atol=1e-12)


def test_only_what_axes_move_is_sent_again() -> None:
    machine = load_machine("robot-dog")
    shape = shape_of(machine, build_kinematics(machine), CUBE)
    (moving,) = moving_frames(shape, [1], np.zeros((1, len(machine.axes))))
    sent = FrameTransforms.FromString(moving).transforms
    standing = FrameTransforms.FromString(standing_frames(shape, 1)).transforms
    assert len(sent) == 12
    assert {each.child_frame_id for each in sent}.isdisjoint(each.child_frame_id for each in standing)
    assert {each.child_frame_id for each in (*sent, *standing)} == set(shape.tree.links)


def test_bodies_hang_on_what_carries_them() -> None:
    table = CARRIED.format(name="table", more="opposite = true\n")
    machine = mill(CARRIED.format(name="head", more=""), table)
    positions = np.zeros((1, len(machine.axes)))
    positions[0, 0] = 0.25
    shape, (frames,) = shape_and_frames(machine, positions)
    head, opposite = (part.name for part in shape.parts[-2:])
    assert frames.pose(head, PORTAL)[0, 3] == pytest.approx(0.25)
    assert frames.pose(opposite, PORTAL)[0, 3] == pytest.approx(-0.25)


def test_zones_are_seen_through_and_bodies_are_not() -> None:
    machine = mill(VISE, DOOR)
    shape = shape_of(machine, build_kinematics(machine), CUBE)
    path = {None: np.zeros((3, 3))}
    entities = SceneUpdate.FromString(scene_update(shape, 7, path)).entities
    (zone,) = (each for each in entities if each.id == "zone 1")
    (line,) = (each for each in entities if each.id == "path")
    corners = np.array([[each.x, each.y, each.z] for each in zone.triangles[0].points])
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.01, 0.02, 0.03])
    assert zone.triangles[0].color.a == ZONE_ALPHA
    assert all(each.triangles[0].color.a == 1.0 for each in entities[:-2])
    assert len(line.lines[0].points) == 3
    assert len({each.id for each in entities}) == len(entities)
    assert all(each.frame_locked for each in entities)


def test_the_path_of_a_tool_goes_along_with_the_table_that_carries_its_work() -> None:
    machine = load_machine("examples/trunnion-mill.toml")
    shape = shape_of(machine, build_kinematics(machine), CUBE)
    paths = {1: np.zeros((3, 3))}
    scene = SceneUpdate.FromString(scene_update(shape, 7, paths))
    assert [each.frame_id for each in scene.entities if each.id == "path T1"] == ["table"]
    ((channel, message),) = path_clouds(shape, 7, paths)
    assert (channel.topic, PointCloud.FromString(message).frame_id) == ("/path/table", "table")


def test_joints_have_the_names_of_the_urdf_and_only_what_was_measured() -> None:
    machine = load_machine("robot-dog")
    shape = shape_of(machine, build_kinematics(machine), CUBE)
    positions = np.full((1, len(machine.axes)), 0.5)
    joints = JointStates.FromString(joint_states(shape, [3_000_000_001], positions, torque=positions)[0])
    assert (joints.timestamp.seconds, joints.timestamp.nanos) == (3, 1)
    first = joints.joints[0]
    assert first.name in {joint.name for joint in shape.tree.joints}
    assert (first.position, first.effort) == (0.5, 0.5)
    assert not first.HasField("velocity")
