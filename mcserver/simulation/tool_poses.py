"""Where the tools are: forward kinematics of many cycles at once, in mm and degrees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from mckinematics.pose import Array, Triple
from mckinematics.rotation import GIMBAL_COSINE, rotation_matrices
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.units import DEGREE, MM

if TYPE_CHECKING:
    from mckinematics.solver import MachineKinematics

# rows evaluated together: the chain's matrices stay in the processor's cache
_ROWS_AT_ONCE = 4096


def tool_poses(kinematics: MachineKinematics, tool: int, joints: Array) -> Array:
    """Poses of a tool, shape (n, 6): X Y Z [mm], A B C [deg].

    The angles are principal values in the tool's Euler convention, the middle one in ±90°. Where that one is
    at ±90°, C keeps its value of the row before (0 at the first), as D-51 has it.

    Args:
        joints: shape (n, K), positions of the chain's joints, base to tool [rad or m].
    """
    model = kinematics.tool(tool)
    poses = np.empty((len(joints), 6))
    before: Triple = (0.0, 0.0, 0.0)
    for first in range(0, len(joints), _ROWS_AT_ONCE):
        part = slice(first, first + _ROWS_AT_ONCE)
        positions, rotations = model.chain.forward(joints[part])
        poses[part, :3] = positions / MM
        angles = matrices_to_euler(rotations, model.euler, before)
        if len(angles):
            a, b, c = (float(angle) for angle in angles[-1])
            before = (a, b, c)
        poses[part, 3:] = angles / DEGREE
    return poses


def matrices_to_euler(matrices: Array, order: str, before: Triple = (0.0, 0.0, 0.0)) -> Array:
    """A, B, C [rad] of rotation matrices (n, 3, 3), shape (n, 3); principal values.

    At gimbal lock the later one of the outer angles stays as in the row before: C, or B where C is itself the
    middle angle (D-51).

    Args:
        order: of the factors from left to right, such as ``ZYX``.
        before: A, B, C of the row before the first.
    """
    first, middle, last = ("XYZ".index(letter) for letter in order)
    sign = 1.0 if (middle - first) % 3 == 1 else -1.0
    cosine = np.hypot(matrices[:, first, first], matrices[:, first, middle])
    angles = np.empty((len(matrices), 3))
    angles[:, middle] = np.arctan2(sign * matrices[:, first, last], cosine)
    angles[:, first] = np.arctan2(-sign * matrices[:, middle, last], matrices[:, last, last])
    angles[:, last] = np.arctan2(-sign * matrices[:, first, middle], matrices[:, first, first])
    locked = cosine <= GIMBAL_COSINE
    if not locked.any():
        return angles
    kept, free = max(first, last), min(first, last)
    latest = np.maximum.accumulate(np.where(locked, -1, np.arange(len(matrices))))
    angles[locked, kept] = np.where(latest < 0, before[kept], angles[latest, kept])[locked]
    inner = _about(middle, angles[locked, middle]).swapaxes(1, 2)
    outer = _about(kept, angles[locked, kept]).swapaxes(1, 2)
    # what the two known factors leave of the orientation is the turn about the free axis
    rest = inner @ outer @ matrices[locked] if kept == first else matrices[locked] @ outer @ inner
    after, beyond = (free + 1) % 3, (free + 2) % 3
    angles[locked, free] = np.arctan2(rest[:, beyond, after], rest[:, after, after])
    return angles


class ToolPoses:
    """The poses of all tools of a machine, from the positions of all its axes.

    Args:
        machine: whose axes the columns are.
        kinematics: of its tools; None gives no poses.

    Attributes:
        numbers: the tools, sorted.
    """

    def __init__(self, machine: Machine, kinematics: MachineKinematics | None) -> None:
        self._kinematics = kinematics
        self.numbers: tuple[int, ...] = () if kinematics is None else kinematics.tools
        column = {axis.index: at for at, axis in enumerate(machine.axes)}
        self._columns: Mapping[int, Sequence[int]] = (
            {}
            if kinematics is None
            else {tool: [column[axis] for axis in kinematics.axes(tool)] for tool in kinematics.tools}
        )

    def axes(self, tool: int) -> tuple[int, ...]:
        """Return the axis numbers of a tool's chain."""
        return () if self._kinematics is None else tuple(self._kinematics.axes(tool))

    def of(self, tool: int, positions: NDArray[np.float64]) -> Array:
        """Shape (n, 6), X Y Z [mm] and A B C [deg]; ``positions`` (n, K) of all the machine's axes [SI]."""
        if self._kinematics is None:
            raise KeyError(tool)
        return tool_poses(self._kinematics, tool, positions[:, self._columns[tool]])


def _about(axis: int, angles: Array) -> Array:
    """Rotations about X, Y or Z, shape (n, 3, 3)."""
    vectors = np.zeros((len(angles), 3))
    vectors[:, axis] = angles
    return rotation_matrices(vectors)
