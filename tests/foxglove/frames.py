"""Frames put together from messages, as a viewer does."""

from __future__ import annotations

from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


class Frames:
    """All frames of some messages of ``foxglove.FrameTransforms``; the newest of each child counts."""

    def __init__(self, *messages: bytes) -> None:
        self._parents: dict[str, tuple[str, Array]] = {}
        for message in messages:
            for each in FrameTransforms.FromString(message).transforms:
                self._parents[each.child_frame_id] = (each.parent_frame_id, _pose(each))

    def pose(self, frame: str, root: str) -> Array:
        """A frame's pose in another one above it, shape (4, 4)."""
        if frame == root:
            return np.eye(4)
        parent, pose = self._parents[frame]
        above: Array = self.pose(parent, root) @ pose
        return above


def _pose(transform: Any) -> Array:
    place, turn = transform.translation, transform.rotation
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    pose[:3, 3] = place.x, place.y, place.z
    return pose
