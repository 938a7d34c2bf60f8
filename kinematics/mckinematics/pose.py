"""Poses, tool paths and joint paths: the values that kinematics takes and gives. SI: metres and radians."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mckinematics.dynamics import JointDynamics
    from mckinematics.even_path import EvenPaths
    from mckinematics.tip_control import TipControl

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Pose:
    """Where a tool is, in the base frame.

    Attributes:
        position: X, Y, Z [m].
        angles: A, B, C about X, Y, Z [rad], in the tool's Euler convention (D-51).
    """

    position: Triple
    angles: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ToolPath:
    """A tool's path over s in [0, 1].

    Attributes:
        position: s of shape (n,) → points of shape (n, 3) [m].
        derivative: s of shape (n,) → dp/ds of shape (n, 3) [m].
        start_angles, end_angles: A, B, C [rad] at s = 0 and 1; None for a tool without orientation. The
            orientation turns about one fixed axis, the short way, in proportion to s (D-51).
    """

    position: Callable[[Array], Array]
    derivative: Callable[[Array], Array]
    start_angles: Triple | None = None
    end_angles: Triple | None = None

    @classmethod
    def straight(
        cls, start: Array, shift: Array, start_angles: Triple | None, end_angles: Triple | None
    ) -> ToolPath:
        """Path on a line from ``start`` to ``start + shift``, shape (3,) each [m]."""
        return cls(
            lambda s: start + s[:, None] * shift,
            lambda s: np.tile(shift, (len(s), 1)),
            start_angles,
            end_angles,
        )


@dataclass(frozen=True)
class JointPath:
    """A joint path as a cubic spline.

    Attributes:
        axes: K axis numbers, the tool's chain in order.
        knots: shape (M,), from 0 to 1.
        coefficients: shape (4, M-1, K), highest power first, in (s - knots[i]).
    """

    axes: tuple[int, ...]
    knots: Array
    coefficients: Array


class Kinematics(Protocol):
    """What the dialect and the planner need of a machine's tools. ``joints``: axis number → position."""

    @property
    def tools(self) -> tuple[int, ...]:
        """Numbers of the configured tools, sorted."""

    @property
    def dynamics(self) -> JointDynamics | None:
        """Torques of the tools' joints; None where they are not known."""

    def axes(self, tool: int) -> tuple[int, ...]:
        """Axis numbers of the tool's chain, in order."""

    def has_orientation(self, tool: int) -> bool:
        """Return whether A B C are allowed."""

    def pose(self, tool: int, joints: Mapping[int, float]) -> Pose:
        """Forward kinematics."""

    def rotation_angle(self, tool: int, start: Triple, end: Triple) -> float:
        """Angle of the single turn that takes orientation ``start`` to ``end`` [rad] (D-30, D-51)."""

    def jacobians(self, tool: int, joints: Array) -> Array:
        """Rates of the tool's point [m] and, with orientation, of its turn [rad] by those of its joints, at
        positions of the chain's K joints in order, shape (n, K): shape (n, 3 or 6, K).
        """

    def solve_pose(self, tool: int, pose: Pose, joints: Mapping[int, float]) -> tuple[float, ...]:
        """Joint positions of the chain for a pose, nearest to ``joints``; raises `KinematicsError`."""

    def solve_path(self, tool: int, path: ToolPath, joints: Mapping[int, float]) -> JointPath:
        """Joint path that starts at ``joints``; raises `KinematicsError`; nothing is clipped."""

    def solve_even_paths(
        self, tool: int, points: Array, angles: Array | None, joints: Mapping[int, float]
    ) -> EvenPaths:
        """Joints going evenly from ``joints`` along lines between points, shape (n+1, 3) [m], with angles,
        shape (n+1, 3) [rad]; ends before a line where `solve_path` has to decide.
        """

    def tolerances(self, tool: int) -> tuple[float, float]:
        """How far the tool may be off its path [m, rad] (D-54)."""

    def check_beside(
        self, tool: int, path: Array, shares: Array, direction: Triple, window: tuple[float, float]
    ) -> None:
        """Refuse a path, joints (n, K) at shares (n,) of it, beside which the tool cannot be shifted along a
        direction anywhere in a window [m]; raises `KinematicsError`.
        """

    def tip_control(self, tool: int, length: float) -> TipControl:
        """Return the tool with a cutter of a length [m], led by its tip; raises `ModelError`."""
