"""Frames and joints of a machine at many positions of its axes."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from mckinematics.rotation import rotation_matrices
from scipy.spatial.transform import Rotation

from mcserver.foxglove.channels import timestamp
from mcserver.foxglove.shape import WORLD, Shape
from mcserver.view.solids import Array
from mcserver.view.urdf import Joint

TURNING = ("revolute", "continuous")


def _moves(shape: Shape, joint: Joint) -> bool:
    return joint.kind in (*TURNING, "prismatic") and (joint.leader or joint.name) in shape.columns


def moving_frames(shape: Shape, times_ns: list[int], positions: Array) -> list[bytes]:
    """Write ``foxglove.FrameTransforms`` of the joints that axes move, one for each row.

    Args:
        positions: shape (N, K), of all the machine's axes [SI].
    """
    joints = [joint for joint in shape.tree.joints if _moves(shape, joint)]
    placed = [_transforms(joint, _values(shape, joint, positions)) for joint in joints]
    names = [(joint.parent, joint.child) for joint in joints]
    messages = []
    for row, time_ns in enumerate(times_ns):
        stamp = timestamp(time_ns)
        transforms = [
            transform(parent, child, place[row], turn[row], stamp)
            for (parent, child), (place, turn) in zip(names, placed, strict=True)
        ]
        messages.append(FrameTransforms(transforms=transforms).SerializeToString())
    return messages


def standing_frames(shape: Shape, time_ns: int) -> bytes:
    """Write ``foxglove.FrameTransforms`` of what no axis moves, and of the root in a world with Z up."""
    stamp = timestamp(time_ns)
    found = [transform(WORLD, shape.tree.root, np.zeros(3), _turn_to_z(shape.up), stamp)]
    for joint in shape.tree.joints:
        if not _moves(shape, joint):
            place, turns = _transforms(joint, np.full(1, joint.offset if joint.leader else 0.0))
            found.append(transform(joint.parent, joint.child, place[0], turns[0], stamp))
    written: bytes = FrameTransforms(transforms=found).SerializeToString()
    return written


def joint_states(
    shape: Shape,
    times_ns: list[int],
    positions: Array,
    velocity: Array | None = None,
    torque: Array | None = None,
) -> list[bytes]:
    """Write ``foxglove.JointStates`` of all axes, one for each row; shapes (N, K) [SI]."""
    messages = []
    for row, time_ns in enumerate(times_ns):
        joints = [JointState(name=name, position=positions[row, at]) for at, name in enumerate(shape.joints)]
        for at, joint in enumerate(joints):
            if velocity is not None:
                joint.velocity = velocity[row, at]
            if torque is not None:
                joint.effort = torque[row, at]
        messages.append(JointStates(timestamp=timestamp(time_ns), joints=joints).SerializeToString())
    return messages


def _values(shape: Shape, joint: Joint, positions: Array) -> Array:
    found: Array = positions[:, shape.columns[joint.leader or joint.name]]
    return joint.ratio * found + joint.offset if joint.leader else found


def _transforms(joint: Joint, values: Array) -> tuple[Array, Array]:
    """Return places (N, 3) [m] and unit quaternions (N, 4) of a joint's child in its parent."""
    places = np.tile(joint.pose[:3, 3], (len(values), 1))
    turns = np.tile(joint.pose[:3, :3], (len(values), 1, 1))
    if joint.kind in TURNING:
        turns = turns @ rotation_matrices(values[:, None] * joint.axis)
    elif joint.kind == "prismatic":
        places = places + values[:, None] * (joint.pose[:3, :3] @ joint.axis)
    return places, Rotation.from_matrix(turns).as_quat()


def _turn_to_z(up: Array) -> Array:
    """Return the quaternion that turns a unit vector upright."""
    x, y, z = (float(value) for value in up)
    if z < -1.0 + 1e-9:
        return np.array([1.0, 0.0, 0.0, 0.0])
    turn = np.array([y, -x, 0.0, 1.0 + z])
    unit: Array = turn / np.linalg.norm(turn)
    return unit


def transform(parent: str, child: str, place: Array, turn: Array, stamp: Timestamp) -> FrameTransform:
    """Return a child frame in its parent: place (3,) [m], unit quaternion x, y, z, w."""
    x, y, z = place.tolist()
    qx, qy, qz, qw = turn.tolist()
    return FrameTransform(
        timestamp=stamp,
        parent_frame_id=parent,
        child_frame_id=child,
        translation=Vector3(x=x, y=y, z=z),
        rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
    )
