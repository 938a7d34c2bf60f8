"""Frames of a robot for tf: its links by the URDF, and the tips of its tools as the server has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mcclient.types import ToolInfo, ToolPose
from mckinematics.rotation import euler_to_matrix
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mcserver.ros.interfaces import interfaces
from mcserver.units import DEGREE, MM
from mcserver.view.stage import work_links
from mcserver.view.urdf import Tree

Array = NDArray[np.float64]
TF = "tf2_msgs/msg/TFMessage"


class Frames:
    """Transforms from frame to frame.

    Args:
        tree: of the URDF. prefix: of every frame's name, such as ``cell_1/``; empty for one machine alone.
    """

    def __init__(self, tree: Tree, tools: Sequence[ToolInfo], prefix: str) -> None:
        self._prefix = prefix
        self._bases = work_links(tree, tools)
        self._fixed = [joint for joint in tree.joints if joint.kind == "fixed"]
        self._moving = [joint for joint in tree.joints if joint.kind != "fixed"]
        self._euler = {tool.number: tool.euler for tool in tools}

    def base(self, tool: int) -> str:
        """Return the frame in which a tool's poses are, as tf names it."""
        return self._prefix + self._bases[tool]

    def fixed(self, stamp: Any) -> Any:
        """Return the joints that do not move, as a message for ``/tf_static``."""
        pairs = [(joint.parent, joint.child) for joint in self._fixed]
        return self._message(stamp, pairs, [joint.child_pose({}) for joint in self._fixed])

    def moving(self, stamp: Any, positions: Mapping[str, float]) -> Any:
        """Return the other joints; ``positions`` by joint's name [m, rad]."""
        pairs = [(joint.parent, joint.child) for joint in self._moving]
        return self._message(stamp, pairs, [joint.child_pose(positions) for joint in self._moving])

    def tips(self, stamp: Any, poses: Sequence[ToolPose]) -> Any:
        """Return the tips ``tool_N`` in the frames in which their poses are."""
        placed = []
        for pose in poses:
            matrix = np.eye(4)
            angles = tuple(DEGREE * angle for angle in pose.orientation)
            matrix[:3, :3] = euler_to_matrix(angles, self._euler.get(pose.number, "ZYX"))  # type: ignore[arg-type]
            matrix[:3, 3] = MM * np.array(pose.position)
            placed.append(matrix)
        pairs = [(self._bases[pose.number], f"tool_{pose.number}") for pose in poses]
        return self._message(stamp, pairs, placed)

    def _message(self, stamp: Any, pairs: Sequence[tuple[str, str]], placed: Sequence[Array]) -> Any:
        make = interfaces().make
        if not pairs:
            return make(TF)
        quaternions = Rotation.from_matrix(np.array(placed)[:, :3, :3]).as_quat()
        transforms = []
        for (parent, child), matrix, (x, y, z, w) in zip(pairs, placed, quaternions.tolist(), strict=True):
            at = make("geometry_msgs/msg/Vector3", **dict(zip("xyz", matrix[:3, 3].tolist(), strict=True)))
            turned = make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
            transforms.append(
                make(
                    "geometry_msgs/msg/TransformStamped",
                    header=make("std_msgs/msg/Header", stamp=stamp, frame_id=self._prefix + parent),
                    child_frame_id=self._prefix + child,
                    transform=make("geometry_msgs/msg/Transform", translation=at, rotation=turned),
                )
            )
        return make(TF, transforms=transforms)
