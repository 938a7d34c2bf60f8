"""Refuse paths where a joint cannot hold against gravity (D-55), or a tool its leader's motion (D-145)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from mckinematics.errors import KinematicsError
from mckinematics.text import degrees_text, millimetres_text

from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.tool_moves import report_unsolved
from mcserver.gcode.text.profile_words import Action
from mcserver.gcode.text.syntax import Command
from mcserver.motion.geometry.curves import Array, Curve
from mcserver.motion.geometry.torque_limits import APART, HOLDING_SHARE, MOST_SAMPLES
from mcserver.units import AxisType

# Shares of a path at which the joints' positions are sampled.
PROBES = np.linspace(0.0, 1.0, 17)
# Between places that are looked at for a leader's motion joints turn by this at the most, in so many places
# [rad or m].
WINDOW_APART = 0.2
MOST_PLACES = 17


def check_holding(
    block: BlockState, command: Command | Action, curves: Iterable[Curve], before: Mapping[int, float]
) -> None:
    """Report MC314 where gravity alone exceeds a joint's torque along a path.

    Args:
        curves: that move together. before: positions of all axes at their start [m or rad].
    """
    dynamics = block.setup.dynamics
    moved = [curve for curve in curves if dynamics is not None and set(curve.axes) & set(dynamics.axes)]
    if dynamics is None or not moved or not block.commanded.guessed.isdisjoint(dynamics.axes):
        return
    travel = np.abs(np.diff(_joints(dynamics.axes, moved, before, PROBES), axis=0)).sum(axis=0).max()
    s = np.linspace(0.0, 1.0, min(2 + math.ceil(float(travel) / APART), MOST_SAMPLES))
    joints = _joints(dynamics.axes, moved, before, s)
    torques = dynamics.at_rest(joints, block.modal.carried)
    shares = np.abs(torques) / dynamics.limits
    if not shares.max() > HOLDING_SHARE:
        return
    # the first place where a limit is exceeded, and the joint that exceeds its limit most there
    place = int(np.argmax((shares > HOLDING_SHARE).any(axis=1)))
    joint = int(np.argmax(shares[place]))
    axis, torque = dynamics.axes[joint], abs(float(torques[place, joint]))
    position = float(joints[place, joint])
    rotary = block.setup.axes[axis].type is AxisType.ROTARY
    shown = f"{degrees_text(position)} deg" if rotary else f"{millimetres_text(position)} mm"
    block.faults.add(
        "MC314",
        f"axis {axis} (joint {dynamics.joint_name(axis)!r}) needs {torque:.4g} N·m to be held still at"
        f" {shown}, {100.0 * s[place]:.4g} % of the path; its max_torque is {dynamics.limits[joint]:.4g} N·m",
        block.span(command),
        "take a lighter payload, or a path on which it stands closer to the joint",
        axis=axis,
        tool=block.modal.tool,
    )


def check_window(
    block: BlockState, command: Command | Action, curves: Sequence[Curve], before: Mapping[int, float]
) -> None:
    """Report a path on which what a tool follows may take it where its joints cannot hold it.

    Where the path begins it has been looked at: by the move before, or at G1060.

    Args:
        curves: that move together. before: positions of all axes ahead of them [m or rad].
    """
    coupled, kinematics = dict(block.modal.coupled), block.setup.kinematics
    for tool in block.setup.machine.tools if coupled and kinematics is not None else ():
        follow = tool.follow
        moved = [curve for curve in curves if not set(curve.axes).isdisjoint(tool.axes)]
        if follow is None or follow.superimposed is None or tool.axes[0] not in coupled or not moved:
            continue
        if not block.commanded.guessed.isdisjoint(tool.axes):
            continue
        shares = np.linspace(0.0, 1.0, MOST_PLACES)
        joints = _joints(tool.axes, moved, before, shares)
        travel = float(np.abs(np.diff(joints, axis=0)).sum(axis=0).max())
        count = min(max(math.ceil(travel / WINDOW_APART), 1), MOST_PLACES - 1)
        looked = np.linspace(0, MOST_PLACES - 1, count + 1).round().astype(int)[1:]
        x, y, z = follow.direction
        window = (follow.superimposed.low, follow.superimposed.high)
        try:
            assert kinematics is not None
            kinematics.check_beside(tool.number, joints[looked], shares[looked], (x, y, z), window)
        except KinematicsError as error:
            report_unsolved(block, command, tool.number, error)


def _joints(axes: Sequence[int], curves: list[Curve], before: Mapping[int, float], s: Array) -> Array:
    """Return the positions of joints at shares of a path, shape (n, J)."""
    found = np.tile([before[axis] for axis in axes], (len(s), 1))
    for curve in curves:
        position = curve.position(s)
        for column, axis in enumerate(curve.axes):
            if axis in axes:
                found[:, axes.index(axis)] = position[:, column]
    return found
