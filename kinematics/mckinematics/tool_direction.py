"""Positions of two turning joints at which a tool points in a given direction.

Source: the second subproblem of Paden and Kahan (Murray, Li and Sastry, A Mathematical Introduction to
Robotic Manipulation, 3.2).
"""

from __future__ import annotations

import math

import numpy as np

from mckinematics.chain import Chain
from mckinematics.errors import ModelError
from mckinematics.pose import Array

# sines below which directions are one, and the joint between them may stand anywhere [1]
SAME_DIRECTION = 1e-9
# by how much a direction may be out of reach: what numbers of a program are rounded to [1]
OUT_OF_REACH = 1e-9


def turns_towards(chain: Chain, direction: Array, near: Array) -> list[tuple[float, float]]:
    """Return the two turning joints' positions at which the tool's Z points in a direction, both ways.

    Args:
        direction: shape (3,), a unit vector in the chain's base. near: shape (2,), where the joints are: each
            position is within half a turn of it [rad], and one that may be any is that.

    Returns:
        None to two pairs, in the chain's order.

    Raises:
        ModelError: the tool has not two turning joints that are askew.
    """
    turning = np.flatnonzero(chain.revolute)
    axes = chain.directions[turning]
    if len(turning) != 2 or np.linalg.norm(np.cross(axes[0], axes[1])) < SAME_DIRECTION:
        raise ModelError(
            f"a direction needs two rotary axes that are not parallel, and the tool has {len(turning)}",
            "let the CAM write the moves out for the axes of this machine",
        )
    first, second = axes
    tool = chain.tip_rotation[:, 2]
    # between the joints the direction has its share along the first one already, and still that along the
    # second one
    cosine = float(first @ second)
    across = np.cross(first, second)
    along_first, along_second = float(first @ direction), float(second @ tool)
    a = (along_first - cosine * along_second) / (1.0 - cosine * cosine)
    b = (along_second - cosine * along_first) / (1.0 - cosine * cosine)
    inside = a * first + b * second
    rest = 1.0 - float(inside @ inside)
    if rest < -OUT_OF_REACH:
        return []
    height = math.sqrt(max(rest, 0.0) / float(across @ across))
    # nearer than rounding is the same solution
    signs = (1.0,) if height < math.sqrt(OUT_OF_REACH) else (1.0, -1.0)
    found = []
    for sign in signs:
        between = inside + sign * height * across
        found.append(
            (
                _nearest(_angle(first, between, direction, near[0]), near[0]),
                _nearest(_angle(second, tool, between, near[1]), near[1]),
            )
        )
    return found


def _angle(axis: Array, start: Array, end: Array, free: float) -> float:
    """Return the turn about an axis that takes a direction to another one; ``free`` where any does."""
    begin, finish = start - axis * (axis @ start), end - axis * (axis @ end)
    if float(np.linalg.norm(begin)) < SAME_DIRECTION or float(np.linalg.norm(finish)) < SAME_DIRECTION:
        return float(free)
    return math.atan2(float(axis @ np.cross(begin, finish)), float(begin @ finish))


def _nearest(angle: float, near: float) -> float:
    return angle + 2.0 * math.pi * round((near - angle) / (2.0 * math.pi))
