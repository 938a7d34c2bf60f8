"""A serial chain of one-degree joints: forward kinematics and Jacobians of many positions at once.

Each joint has a frame whose z is the joint's axis, so that it turns about z or slides along it. From frame to
frame is a fixed matrix: one product for all positions together. The turn about z multiplies x - i·y by
exp(i·q): with the columns x, -y side by side, one complex product for all positions together.
Evaluating all knots of a path together in numpy is ten times quicker than a loop over single positions.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mckinematics.pose import Array, BoolArray
from mckinematics.single import SingleChain

# from columns x, y, z, p to x, -y, z, p and back
_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])
_MIRROR.setflags(write=False)


@dataclass(frozen=True)
class Chain:
    """K joints from the base to a tool, read-only.

    Attributes:
        axes: K axis numbers, base to tool. joint_names: the joints' names in the URDF.
        revolute: shape (K,), True for turning joints, False for sliding ones.
        directions: shape (K, 3), unit vectors of the joints' axes, all joints at zero, in the base frame.
        points: shape (K, 3), a point on each turning joint's axis [m].
        tip_rotation, tip_position: shapes (3, 3) and (3,), the tool with all joints at zero [m].
        lower, upper: shape (K,), joint limits, infinite where a joint has no limit [rad or m].
        reach: sum of the distances from joint to joint to tool; the chain's length scale [m].
        carried: how many of the joints, the first ones, move the frame that the chain begins at.
        steps: shape (K + 1, 4, 4), from the base to the first joint's frame, from frame to frame, and from
            the last one to the tool, all joints at zero; each frame's z is its joint's axis.
        single: the same chain for one position at a time.
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
    carried: int = 0
    steps: Array = field(init=False, repr=False)
    single: SingleChain = field(init=False, repr=False)
    _base: Array = field(init=False, repr=False)
    _mirrored: tuple[Array, ...] = field(init=False, repr=False)
    _turning: tuple[bool, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        count = len(self.axes)
        zero = np.tile(np.eye(4), (count + 2, 1, 1))
        for joint in range(count):
            zero[joint + 1, :3, :3] = _frame_along(self.directions[joint])
            zero[joint + 1, :3, 3] = self.points[joint]
        zero[-1, :3, :3] = self.tip_rotation
        zero[-1, :3, 3] = self.tip_position
        steps = np.linalg.inv(zero[:-1]) @ zero[1:]
        mirrored = [_MIRROR @ step @ _MIRROR for step in steps[:-1]] + [_MIRROR @ steps[-1]]
        base = steps[0, :3] @ _MIRROR
        for shared in (steps, base, *mirrored):
            shared.setflags(write=False)
        object.__setattr__(self, "steps", steps)
        object.__setattr__(self, "_base", base)
        object.__setattr__(self, "_mirrored", tuple(mirrored))
        turning = tuple(bool(each) for each in self.revolute)
        object.__setattr__(self, "_turning", turning)
        object.__setattr__(self, "single", SingleChain(steps, turning))

    @property
    def size(self) -> int:
        """K, the number of joints."""
        return len(self.axes)

    def forward(self, joints: Array) -> tuple[Array, Array]:
        """Tool positions (n, 3) [m] and rotations (n, 3, 3) of joint positions (n, K) [rad or m]."""
        tip = self._frames(joints)[1]
        return tip[:, :, 3], tip[:, :, :3]

    def jacobian(self, joints: Array, rows: int = 6) -> tuple[Array, Array, Array]:
        """As `forward`, and the Jacobians, shape (n, rows, K).

        Rows 0-2: velocity of the tool's point, rows 3-5: angular velocity, both along the base's axes;
        ``rows`` is 3 or 6.
        """
        frames, tip = self._frames(joints)
        jacobian = np.empty((len(joints), rows, self.size))
        ax, ay, az = frames[..., 0, 2], frames[..., 1, 2], frames[..., 2, 2]
        arm = tip[:, :, 3] - frames[..., 3]
        rx, ry, rz = arm[..., 0], arm[..., 1], arm[..., 2]
        columns = jacobian.transpose(1, 2, 0)
        np.subtract(ay * rz, az * ry, out=columns[0])
        np.subtract(az * rx, ax * rz, out=columns[1])
        np.subtract(ax * ry, ay * rx, out=columns[2])
        directions = frames[..., 2].transpose(2, 0, 1)
        if rows == 6:
            columns[3:] = directions
        for joint, turning in enumerate(self._turning):
            if not turning:
                columns[:3, joint] = directions[:, joint]
                columns[3:, joint] = 0.0
        return tip[:, :, 3], tip[:, :, :3], jacobian

    def _frames(self, joints: Array) -> tuple[Array, Array]:
        """Joints' frames, shape (K, n, 3, 4), columns x, -y, z, origin; the tool's, shape (n, 3, 4)."""
        count, size = joints.shape
        turns = np.empty((size, count, 1), dtype=np.complex128)
        np.cos(joints.T[..., None], out=turns.real)
        np.sin(joints.T[..., None], out=turns.imag)
        frames = np.empty((size, count, 3, 4))
        flat = frames.reshape(size, 3 * count, 4)
        across = frames.view(np.complex128)[..., 0]
        frames[0] = self._base
        for joint, turning in enumerate(self._turning):
            if joint:
                np.dot(flat[joint - 1], self._mirrored[joint], out=flat[joint])
            if turning:
                across[joint] *= turns[joint]
            else:
                frames[joint, :, :, 3] += joints[:, joint, None] * frames[joint, :, :, 2]
        return frames, (flat[-1] @ self._mirrored[-1]).reshape(count, 3, 4)


def _frame_along(direction: Array) -> Array:
    """Return a rotation matrix whose third column is this unit vector."""
    across = np.cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
    across = across / np.linalg.norm(across)
    return np.stack([across, np.cross(direction, across), direction], axis=1)
