"""A cutter's tip led along a path while the turning joints go as written: tool centre point control.

The sliding joints move the tip along directions that depend on the turning joints alone, so that for given
turns they follow from the tip's place by three linear equations: there is one solution, and none is singular
but in a machine whose sliding joints lie in a plane.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mckinematics import refusal
from mckinematics.errors import KinematicsError, ModelError
from mckinematics.even_path import SAMPLES, EvenPaths, leading, samples_of
from mckinematics.pose import Array, JointPath
from mckinematics.search import LIMIT_SLACK, within_limits
from mckinematics.spline import clamped_spline, evaluate_cells, spline_extremes
from mckinematics.tool import ToolModel

# share of the tool's tolerance that the spline may miss the path by, as of `mckinematics.fit`
FIT_SHARE = 0.2
FIRST_CELLS, MOST_CELLS = 2, 1 << 12
# how far the sliding joints may be from right angles and equal scales [1]
SQUARE = 1e-6
# uneven, so that a circle of many turns is not met at one point
_INSIDE = np.array([0.19, 0.5, 0.77])


@dataclass(frozen=True)
class Lead:
    """Where the tip is to go over s in [0, 1], while the turning joints go evenly.

    Attributes:
        position, derivative: s of shape (n,) → points and their rates by s, shape (n, 3) [m].
        start: shape (K,), the joints at s = 0. turns: shape (T,), the turning joints at s = 1 [rad].
    """

    position: Callable[[Array], Array]
    derivative: Callable[[Array], Array]
    start: Array
    turns: Array


@dataclass(frozen=True)
class TipControl:
    """A tool with three sliding joints and any turning ones, and the cutter that it holds.

    Attributes:
        tool: its frame's Z points from the cutter's tip to its shank.
        length: of the cutter, from the tool's point to its tip [m].
        sliding, turning: their columns in the chain.

    Raises:
        ModelError: the tool has not three sliding joints that span space.
    """

    tool: ToolModel
    length: float
    sliding: NDArray[np.intp] = field(init=False)
    turning: NDArray[np.intp] = field(init=False)

    def __post_init__(self) -> None:
        chain = self.tool.chain
        object.__setattr__(self, "sliding", np.flatnonzero(~chain.revolute))
        object.__setattr__(self, "turning", np.flatnonzero(chain.revolute))
        directions = chain.directions[self.sliding]
        if len(directions) != 3 or abs(float(np.linalg.det(directions))) < SQUARE:
            raise ModelError(
                f"tool {self.tool.number} has {len(directions)} sliding joints"
                f"{' in one plane' * (len(directions) == 3)}: they cannot lead a tip while others turn",
                "list the joints from the work piece's frame (work) to the tool's, three of them sliding",
                tool=self.tool.number,
            )

    def tip(self, joints: Array) -> Array:
        """Return where the tip is, shape (n, 3) [m], for joints (n, K)."""
        positions, rotations = self.tool.chain.forward(joints)
        return np.asarray(positions - self.length * rotations[:, :, 2])

    def rates(self, joints: Array) -> Array:
        """Rates of the tip [m] and of the cutter's turn [rad] by those of the joints, shape (n, 6, K)."""
        return self._linearise(joints)[1]

    def base(self, turns: Array) -> tuple[Array, Array]:
        """Where the sliding joints carry the tool's point, without a cutter, at given turns, shape (T,).

        Returns:
            A (3, 3) and b (3,) of the point b + A·q, q the sliding joints in the chain's order.

        Raises:
            ModelError: they are not at right angles there, so that they are no axes of coordinates.
        """
        joints = np.zeros((1, self.tool.chain.size))
        joints[0, self.turning] = turns
        positions, _, rates = self.tool.chain.jacobian(joints, 3)
        across: Array = rates[0][:, self.sliding]
        off = float(np.abs(across.T @ across - np.eye(3)).max())
        if off > SQUARE:
            raise ModelError(
                f"tool {self.tool.number}: its sliding joints are off right angles by {off:.2g}",
                "let the URDF have them square; a table of errors is another matter",
                tool=self.tool.number,
            )
        return across, positions[0]

    def solve(self, points: Array, turns: Array) -> Array:
        """Joints, shape (n, K), that have the tip at points (n, 3) with turns (n, T)."""
        joints = np.zeros((len(points), self.tool.chain.size))
        joints[:, self.turning] = turns
        tips, rates = self._linearise(joints)
        joints[:, self.sliding] = _solved(rates[:, :3, self.sliding], points - tips)
        return joints

    def even_paths(self, points: Array, turns: Array, start: Array) -> EvenPaths:
        """Return the joints going evenly along consecutive lines of the tip, up to one that passes a limit.

        Args:
            points: where the first line begins and where each ends, shape (n+1, 3) [m]. turns: of the
                turning joints there, shape (n+1, T) [rad]. start: joints at the first, shape (K,).
        """
        joints = np.concatenate((start[None], self.solve(points[1:], turns[1:])))
        count = leading(within_limits(self.tool, joints[1:]))
        joints, points = joints[: count + 1], points[: count + 1]
        tips, rates = self._linearise(samples_of(joints))
        starts, travels = points[:-1, None], np.diff(points, axis=0)[:, None]
        shape = (count, len(SAMPLES), 3)
        residual = starts + SAMPLES[:, None] * travels - tips.reshape(shape)
        return EvenPaths.of(joints, rates[:, :3].reshape(*shape, joints.shape[1]), residual)

    def path(self, lead: Lead) -> JointPath:
        """Joint path that keeps the tip on its path within the tool's tolerance.

        Raises:
            JointLimit: a joint would pass its limit. KinematicsError: too many bends.
        """
        begin = lead.start[self.turning]
        travel = lead.turns - begin

        def at(s: Array) -> Array:
            return self.solve(lead.position(s), begin + s[:, None] * travel)

        def slope(joints: Array, s: float) -> Array:
            rates = self._linearise(joints[None])[1][0, :3]
            moved = np.zeros(self.tool.chain.size)
            moved[self.turning] = travel
            missing = lead.derivative(np.array([s]))[0] - rates @ moved
            moved[self.sliding] = _solved(rates[None, :, self.sliding], missing[None])[0]
            return moved

        cells = FIRST_CELLS
        while cells <= MOST_CELLS:
            knots = np.arange(cells + 1) / cells
            joints = at(knots)
            joints[0] = lead.start
            spline = clamped_spline(knots, joints, slope(joints[0], 0.0), slope(joints[-1], 1.0))
            s, reached = evaluate_cells(knots, spline, _INSIDE)
            off = self.tip(reached.reshape(-1, reached.shape[2])) - lead.position(s.ravel())
            if float(np.einsum("ij,ij->i", off, off).max()) <= (FIT_SHARE * self.tool.tolerance) ** 2:
                self._refuse_limits(lead, knots, spline)
                return JointPath(self.tool.chain.axes, knots, spline)
            cells *= 2
        raise KinematicsError(
            f"tool {self.tool.number}: the path has too many bends to be solved as one",
            "divide it into several lines, each of fewer turns",
            tool=self.tool.number,
        )

    def _refuse_limits(self, lead: Lead, knots: Array, spline: Array) -> None:
        chain = self.tool.chain
        for values in spline_extremes(knots, spline):
            beyond = np.maximum(chain.lower - values, values - chain.upper)
            cell, column = (int(each) for each in np.unravel_index(np.argmax(beyond), beyond.shape))
            excess, s = float(beyond[cell, column]), float(knots[cell])
            if excess > LIMIT_SLACK:
                left = 0.0 if chain.revolute[column] else excess
                value, place = float(values[cell, column]), lead.position(np.array([s]))[0]
                raise refusal.joint_limit(self.tool, column, value, place, s, left)

    def _linearise(self, joints: Array) -> tuple[Array, Array]:
        positions, rotations, rates = self.tool.chain.jacobian(joints)
        arm = -self.length * rotations[:, :, 2]
        x, y, z = arm.T[:, :, None]
        turn_x, turn_y, turn_z = rates[:, 3], rates[:, 4], rates[:, 5]
        rates[:, 0] += turn_y * z - turn_z * y
        rates[:, 1] += turn_z * x - turn_x * z
        rates[:, 2] += turn_x * y - turn_y * x
        return positions + arm, rates


def _solved(across: Array, points: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(across, points[..., None])[..., 0], dtype=np.float64)
    except np.linalg.LinAlgError:
        raise KinematicsError(
            "the sliding joints lie in a plane here: they cannot lead the tip",
            "turn the rotary axes elsewhere",
        ) from None
