"""A tool's path as targets over s, started exactly where the joints are."""

from __future__ import annotations

import numpy as np

from kinematics.errors import KinematicsError, ModelError
from kinematics.pose import Array, ToolPath
from kinematics.rotation import euler_to_matrix, rotation_matrices, rotation_vectors
from kinematics.text import degrees_text, millimetres_text
from kinematics.tool import Targets, ToolModel

# how far the joints given may be from the path's start: rounding, not a jump [m], [rad]
START_TOLERANCE = 1e-6
# largest share by which the path may bend away from its chord's derivative in one cell of the grid
GRID_CURVATURE = 0.06
GRID_START = 8
GRID_LIMIT = 1 << 14


class TargetPath:
    """Targets and their rates over s in [0, 1].

    The orientation is exp(s·w)·R(0), w the rotation vector of the whole turn (D-51). What little the given
    joints are off the path's start is taken back in proportion to s, so that the joint path starts exactly
    at them without a jump.

    Raises:
        ModelError: the joints are not at the path's start.
    """

    def __init__(self, tool: ToolModel, path: ToolPath, joints: Array) -> None:
        self._number = tool.number
        self._path = path
        positions, rotations = tool.chain.forward(joints[None])
        self._shift = positions[0] - np.asarray(path.position(np.zeros(1)), dtype=float)[0]
        allowed = max(START_TOLERANCE, 2.0 * tool.residual_tolerance)
        gap = float(np.linalg.norm(self._shift))
        if not gap <= allowed:
            raise ModelError(
                f"tool {tool.number}: the path starts {millimetres_text(gap)} mm from where the tool is",
                "start the path at the tool's commanded pose",
                tool=tool.number,
                s=0.0,
                residual=gap,
            )
        self._start: Array | None = None
        self._turn = self._twist = np.zeros(3)
        if tool.orientation:
            if path.start_angles is None or path.end_angles is None:
                raise ModelError(
                    f"tool {tool.number}: the path has no orientation",
                    "give A B C at both ends",
                    tool=tool.number,
                )
            self._start = euler_to_matrix(path.start_angles, tool.euler)
            end = euler_to_matrix(path.end_angles, tool.euler)
            self._turn = rotation_vectors((end @ self._start.T)[None])[0]
            self._twist = rotation_vectors((rotations[0] @ self._start.T)[None])[0]
            angle = float(np.linalg.norm(self._twist))
            if not angle <= max(START_TOLERANCE, 2.0 * tool.residual_tolerance_angle):
                raise ModelError(
                    f"tool {tool.number}: the path starts {degrees_text(angle)} deg from where the tool is",
                    "start the path at the tool's commanded pose",
                    tool=tool.number,
                    s=0.0,
                )

    def at(self, s: Array) -> Targets:
        """Targets at s of shape (n,)."""
        rest = 1.0 - s[:, None]
        positions = np.asarray(self._path.position(s), dtype=float) + rest * self._shift
        if self._start is None:
            return Targets(positions, None)
        turned = rotation_matrices(s[:, None] * self._turn) @ self._start
        return Targets(positions, rotation_matrices(rest * self._twist) @ turned)

    def rates(self, s: Array) -> Array:
        """Velocity of the targets per unit of s: (n, 3) [m], or (n, 6) [m, rad]."""
        velocity: Array = np.asarray(self._path.derivative(s), dtype=float) - self._shift
        if self._start is None:
            return velocity
        spin = (rotation_matrices((1.0 - s[:, None]) * self._twist) @ self._turn) - self._twist
        return np.concatenate([velocity, spin], axis=1)

    def cells(self) -> int:
        """How many even cells of s are needed for the path to be nearly straight in each.

        So a path that comes back to the same point in each cell (a circle of many turns) is not mistaken
        for one that stands still.

        Raises:
            KinematicsError: more than GRID_LIMIT would be needed.
        """
        cells = GRID_START
        while cells <= GRID_LIMIT:
            s = np.linspace(0.0, 1.0, cells + 1)
            points = np.asarray(self._path.position(s), dtype=float)
            velocity = np.asarray(self._path.derivative(s), dtype=float)
            straight = 0.5 * (velocity[1:] + velocity[:-1]) / cells
            bend = np.linalg.norm(points[1:] - points[:-1] - straight, axis=1).max()
            length = np.linalg.norm(velocity, axis=1).max() / cells
            if bend <= GRID_CURVATURE * length + 1e-9:
                return cells
            cells *= 2
        raise KinematicsError(
            f"tool {self._number}: the path has too many bends to be solved as one",
            "divide it into several lines, each of fewer turns",
            tool=self._number,
        )
