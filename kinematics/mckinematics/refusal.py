"""The errors of inverse kinematics, worded: what is wrong where, by how much, and what to change (D-53)."""

from __future__ import annotations

import numpy as np

from mckinematics.errors import BranchJump, JointLimit, Singular, Unreachable
from mckinematics.pose import Array, Triple
from mckinematics.text import degrees_text, joint_text, millimetres_text, point_text
from mckinematics.tool import ToolModel


def unreachable(tool: ToolModel, residual: Array, place: Array, s: float | None) -> Unreachable:
    """``residual`` (rows,) [m, rad] is what is missing; ``place`` (3,) [m] the point asked for.

    On a path (``s``) the residual is that of its furthest point, the place its first bad one.
    """
    distance = float(np.linalg.norm(residual[:3]))
    turn = float(np.linalg.norm(residual[3:]))
    if distance <= tool.tolerance and turn > 0.0:
        missing = f"the point can be reached, but {degrees_text(turn)} deg are missing to this orientation"
        hint = "change A B C, or move the part to where the tool can turn freely"
    else:
        missing = f"{millimetres_text(distance)} mm are missing"
        if tool.orientation:
            missing += " with this orientation"
        hint = "move the target into the tool's reach; no limit of a joint is in the way, its links end there"
        if tool.rank < tool.rows:
            hint += f"; with its {tool.chain.size} joints the tool moves in {tool.rank} directions only"
    if s is None:
        message = f"tool {tool.number} cannot reach {point_text(place)}: {missing}"
    else:
        where = f"{point_text(place)}, {_percent(s)} of the path"
        message = f"tool {tool.number} leaves its reach at {where}: {missing}"
        if distance > tool.tolerance:
            message += " at its furthest point"
    return Unreachable(message, hint, tool=tool.number, s=s, position=_triple(place), residual=distance)


def joint_limit(
    tool: ToolModel, column: int, value: float, place: Array, s: float | None, residual: float | None
) -> JointLimit:
    """Joint ``column`` would need ``value`` [rad or m]; within its limits ``residual`` [m] is missing, None:
    that was not looked for.
    """
    chain = tool.chain
    below = value < chain.lower[column]
    limit = float(chain.lower[column] if below else chain.upper[column])
    axis = chain.axes[column]
    where = f"at {point_text(place)}" + ("" if s is None else f", {_percent(s)} of the path,")
    message = (
        f"tool {tool.number} {where} needs axis {axis} (joint {chain.joint_names[column]!r}) at"
        f" {joint_text(chain, column, value)}; its {'lower' if below else 'upper'} limit is"
        f" {joint_text(chain, column, limit)}"
    )
    hint = "keep the path within the joint's range, start it from another arm configuration, or move the part"
    return JointLimit(
        message,
        hint,
        tool=tool.number,
        s=s,
        position=_triple(place),
        residual=residual,
        axis=axis,
        value=value,
    )


def singular(tool: ToolModel, conditioning: float, place: Array, s: float | None) -> Singular:
    """``conditioning`` is the smallest singular value there (`ToolModel.conditioning`)."""
    where = "" if s is None else f", {_percent(s)} of the path"
    message = (
        f"tool {tool.number} is singular at {point_text(place)}{where}: its joints cannot move it in every"
        f" direction (smallest singular value {conditioning:.2g})"
    )
    hint = "keep away from straight limbs and aligned wrist axes, or move the joints themselves (G1050, G00)"
    return Singular(message, hint, tool=tool.number, s=s, position=_triple(place))


def branch_jump(tool: ToolModel, place: Array, s: float) -> BranchJump:
    """No continuous joint path goes on from s."""
    message = (
        f"tool {tool.number} cannot go on at {point_text(place)}, {_percent(s)} of the path, without a jump"
        " of its joints to another configuration"
    )
    hint = "start from the other configuration, or go to the target with G00"
    return BranchJump(message, hint, tool=tool.number, s=s, position=_triple(place))


def _percent(s: float) -> str:
    return f"{100.0 * s:.4g} %"


def _triple(place: Array) -> Triple:
    x, y, z = (float(value) for value in place)
    return x, y, z
