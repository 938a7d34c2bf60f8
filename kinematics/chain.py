"""A serial chain of one-degree joints: forward kinematics and Jacobians of many positions at once.

The product of exponentials (Brockett): with all joints at zero the tool is at M and joint i turns or slides
along the screw ξᵢ, both seen from the base; at q the tool is at exp(ξ₁q₁)…exp(ξ_K q_K)·M. For a joint of one
degree exp(ξq) = 1 + f₁·ξ + f₂·ξ², where f₁ = sin q, f₂ = 1 - cos q for a turn and f₁ = q, f₂ = 0 for a slide.
Evaluating all knots of a path together in numpy is ten times quicker than a loop over single positions.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from kinematics.pose import Array, BoolArray
from kinematics.rotation import cross_matrices

_IDENTITY = np.eye(4)
_IDENTITY.setflags(write=False)


@dataclass(frozen=True)
class Chain:
    """K joints from the base to a tool, read-only.

    Attributes:
        axes: K axis numbers, base to tool. joint_names: the joints' names in the URDF.
        revolute: shape (K,), True for turning joints, False for sliding ones.
        directions: shape (K, 3), unit vectors of the joints' axes, all joints at zero, in the base frame.
        points: shape (K, 3), a point on each turning joint's axis [m].
        tip_rotation, tip_position: shapes (3, 3) and (3,), the tool with all joints at zero [m].
        lower, upper: shape (K,), joint limits, infinite where there is none [rad or m].
        reach: sum of the distances from joint to joint to tool; the chain's length scale [m].
    """

    axes: tuple[int, ...]
    joint_names: tuple[str, ...]
    revolute: BoolArray
    directions: Array
    points: Array
    tip_rotation: Array
    tip_position: Array
    lower: Array
    upper: Array
    reach: float
    _basis: Array = field(init=False, repr=False)
    _frames: Array = field(init=False, repr=False)
    _tip: Array = field(init=False, repr=False)
    _all_revolute: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        count = len(self.axes)
        screws = np.zeros((count, 4, 4))
        turning = self.revolute
        screws[turning, :3, :3] = cross_matrices(self.directions)[turning]
        screws[turning, :3, 3] = -np.cross(self.directions, self.points)[turning]
        screws[~turning, :3, 3] = self.directions[~turning]
        frames = np.zeros((count, 4, 2))
        frames[:, :3, 0] = self.directions
        frames[:, :3, 1] = self.points
        frames[:, 3, 1] = 1.0
        tip = np.eye(4)
        tip[:3, :3] = self.tip_rotation
        tip[:3, 3] = self.tip_position
        squares = screws @ screws
        basis = np.stack([np.eye(4) + squares, screws, -squares], axis=1).reshape(count, 3, 16)
        for name, value in (("_basis", basis), ("_frames", frames), ("_tip", tip)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_all_revolute", bool(turning.all()))

    @property
    def size(self) -> int:
        """K, the number of joints."""
        return len(self.axes)

    def forward(self, joints: Array) -> tuple[Array, Array]:
        """Tool positions (n, 3) [m] and rotations (n, 3, 3) of joint positions (n, K) [rad or m]."""
        steps = self._exponentials(joints)
        here = steps[:, 0]
        for joint in range(1, self.size):
            here = here @ steps[:, joint]
        tip = here @ self._tip
        return tip[:, :3, 3], tip[:, :3, :3]

    def jacobian(self, joints: Array) -> tuple[Array, Array, Array]:
        """As `forward`, and the Jacobians, shape (n, 6, K).

        Rows 0-2: velocity of the tool's point, rows 3-5: angular velocity, both along the base's axes.
        """
        steps = self._exponentials(joints)
        before = np.empty_like(steps)
        before[:, 0] = _IDENTITY
        for joint in range(1, self.size):
            np.matmul(before[:, joint - 1], steps[:, joint - 1], out=before[:, joint])
        tip = before[:, -1] @ (steps[:, -1] @ self._tip)
        position = tip[:, :3, 3]
        frames = before @ self._frames
        direction = frames[:, :, :3, 0]
        arm = position[:, None, :] - frames[:, :, :3, 1]
        jacobian = np.empty((len(joints), 6, self.size))
        ax, ay, az = direction[..., 0], direction[..., 1], direction[..., 2]
        rx, ry, rz = arm[..., 0], arm[..., 1], arm[..., 2]
        jacobian[:, 0] = ay * rz - az * ry
        jacobian[:, 1] = az * rx - ax * rz
        jacobian[:, 2] = ax * ry - ay * rx
        jacobian[:, 3:] = direction.swapaxes(1, 2)
        if not self._all_revolute:
            sliding = ~self.revolute
            jacobian[:, :3, sliding] = direction[:, sliding].swapaxes(1, 2)
            jacobian[:, 3:, sliding] = 0.0
        return position, tip[:, :3, :3], jacobian

    def _exponentials(self, joints: Array) -> Array:
        # 1 + f₁·ξ + f₂·ξ² as (1 + ξ²) + sin·ξ - cos·ξ², for a slide as 1 + q·ξ (its ξ² is zero)
        weights = np.ones((*joints.shape, 1, 3))
        np.sin(joints, out=weights[..., 0, 1])
        np.cos(joints, out=weights[..., 0, 2])
        if not self._all_revolute:
            weights[..., 0, 1] = np.where(self.revolute, weights[..., 0, 1], joints)
        return (weights @ self._basis).reshape(*joints.shape, 4, 4)
