"""A tool's path as targets over s, started exactly where the joints are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mckinematics.errors import KinematicsError, ModelError
from mckinematics.pose import Array, ToolPath
from mckinematics.rotation import cross_matrices, euler_to_matrix, rotation_matrices, rotation_vectors
from mckinematics.text import degrees_text, millimetres_text
from mckinematics.tool import Targets, ToolModel

# how far the joints given may be from the path's start: rounding, not a jump [m], [rad]
START_TOLERANCE = 1e-6
# a turn at the start that is rounding of the angles alone, far below what counts as reached [rad]
EXACT_START = 1e-13
# largest share by which the path may bend away from its chord's derivative in one cell of the grid
GRID_CURVATURE = 0.06
GRID_START = 8
GRID_LIMIT = 1 << 14


@dataclass(frozen=True)
class Grid:
    """Targets of a path and their rates (n, rows) at even steps of s, shape (n,)."""

    s: Array
    targets: Targets
    rates: Array

    @property
    def cells(self) -> int:
        """n - 1."""
        return len(self.s) - 1


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
        now = tool.chain.single.linearise(joints.tolist())
        self._shift = np.array(now.position) - np.asarray(path.position(np.zeros(1)), dtype=float)[0]
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
        self._exact, self._angle = True, 0.0
        self._first = self._second = np.zeros((3, 3))
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
            self._twist = rotation_vectors((np.reshape(now.rotation, (3, 3)) @ self._start.T)[None])[0]
            angle = float(np.linalg.norm(self._twist))
            if not angle <= max(START_TOLERANCE, 2.0 * tool.residual_tolerance_angle):
                raise ModelError(
                    f"tool {tool.number}: the path starts {degrees_text(angle)} deg from where the tool is",
                    "start the path at the tool's commanded pose",
                    tool=tool.number,
                    s=0.0,
                )
            self._exact = angle <= EXACT_START
            self._angle = float(np.linalg.norm(self._turn))
            axis = self._turn / self._angle if self._angle > 0.0 else np.zeros(3)
            cross = cross_matrices(axis[None])[0]
            self._first, self._second = cross @ self._start, cross @ cross @ self._start

    def at(self, s: Array) -> Targets:
        """Targets at s of shape (n,)."""
        rest = 1.0 - s[:, None]
        positions = np.asarray(self._path.position(s), dtype=float) + rest * self._shift
        if self._start is None:
            return Targets(positions, None)
        angle = s[:, None, None] * self._angle
        # Rodrigues' formula about one axis, times R(0)
        turned = self._start + np.sin(angle) * self._first + (2.0 * np.sin(0.5 * angle) ** 2) * self._second
        return Targets(positions, turned if self._exact else rotation_matrices(rest * self._twist) @ turned)

    def rates(self, s: Array) -> Array:
        """Velocity of the targets per unit of s: (n, 3) [m], or (n, 6) [m, rad]."""
        velocity: Array = np.asarray(self._path.derivative(s), dtype=float) - self._shift
        if self._start is None:
            return velocity
        if self._exact:
            return np.concatenate([velocity, np.broadcast_to(self._turn, velocity.shape)], axis=1)
        spin = (rotation_matrices((1.0 - s[:, None]) * self._twist) @ self._turn) - self._twist
        return np.concatenate([velocity, spin], axis=1)

    def grid(self) -> Grid:
        """Even cells of s, so many that the path is nearly straight in each.

        So a path that comes back to the same point in each cell (a circle of many turns) is not mistaken
        for one that stands still.

        Raises:
            KinematicsError: more than GRID_LIMIT would be needed.
        """
        cells = GRID_START
        while cells <= GRID_LIMIT:
            grid = self.even_grid(cells)
            points, velocity = grid.targets.positions, grid.rates[:, :3]
            gap = points[1:] - points[:-1] - (0.5 / cells) * (velocity[1:] + velocity[:-1])
            # squares: the root is taken of the largest alone
            bend = math.sqrt(np.einsum("ij,ij->i", gap, gap).max())
            length = math.sqrt(np.einsum("ij,ij->i", velocity, velocity).max()) / cells
            if bend <= GRID_CURVATURE * length + 1e-9:
                return grid
            cells *= 2
        raise KinematicsError(
            f"tool {self._number}: the path has too many bends to be solved as one",
            "divide it into several lines, each of fewer turns",
            tool=self._number,
        )

    def even_grid(self, cells: int) -> Grid:
        """Targets and rates at the ends of so many even cells."""
        s = np.arange(cells + 1) / cells
        return Grid(s, self.at(s), self.rates(s))
