"""Short paths of a tool on which all joints may go evenly: lines in joint space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mckinematics.next_pose import solve_near
from mckinematics.path_solver import CLEAR_GAIN
from mckinematics.pose import Array, ToolPath
from mckinematics.target_path import TargetPath
from mckinematics.tool import ToolModel

# s at which the tool is compared with its path
SAMPLES = np.linspace(0.0, 1.0, 5)
SAMPLES.setflags(write=False)
# how far the end may be off its pose [m], [rad]: what Newton's last step leaves, far below `START_TOLERANCE`
END_TOLERANCE = 1e-7


@dataclass(frozen=True)
class EvenPath:
    """Joints that go evenly from where they are.

    Attributes:
        end: shape (K,), the joints at s = 1. fastest: the tool's greatest speed by s [m].
        rates: of the tool by those of the joints at both ends, shape (2, 3 or 6, K).
        off [m], off_angle [rad]: how far the tool is off its path.
    """

    end: Array
    fastest: float
    rates: Array
    off: float
    off_angle: float

    @classmethod
    def of(cls, start: Array, end: Array, rates: Array, residual: Array) -> EvenPath:
        """Return the path from ``start`` to ``end``.

        Args:
            rates, residual: at `SAMPLES`, the tool's rates, shape (n, rows, K), and what it misses its
                path by, shape (n, rows) [m, rad].
        """
        fastest = float(np.linalg.norm(rates[:, :3] @ (end - start), axis=1).max())
        off, off_angle = (
            float(np.linalg.norm(part, axis=1).max()) for part in (residual[:, :3], residual[:, 3:])
        )
        return cls(end, fastest, rates[:: len(SAMPLES) - 1], off, off_angle)


def solve_even_path(tool: ToolModel, path: ToolPath, joints: Array) -> EvenPath | None:
    """Return the joints going evenly along a tool's path.

    Args:
        joints: at the path's start, shape (K,).

    Returns:
        None where the path's end is not near or past a limit, where joints go wild, or where the chain has
        too few joints for poses: `solve_tool_path` decides then.

    Raises:
        ModelError: the joints are not at the path's start.
    """
    if tool.rank < tool.rows:
        return None
    targets = TargetPath(tool, path, joints)
    end = solve_near(tool, targets.at(SAMPLES[-1:]), joints)
    if end is None:
        return None
    travel = end - joints
    speed = tool.tool_speed(targets.rates(SAMPLES[:1]))[0]
    if tool.joint_speed(travel[None])[0] > CLEAR_GAIN * speed:
        return None
    residual, rates = tool.linearise(joints + SAMPLES[:, None] * travel, targets.at(SAMPLES))
    if np.abs(residual[-1]).max() > END_TOLERANCE:
        # beside a singular position a short step may be small without closing the gap
        return None
    return EvenPath.of(joints, end, rates, residual)
