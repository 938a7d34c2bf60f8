"""Refuse motion through positions at which a joint cannot hold against gravity (D-55)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from mckinematics.dynamics import JointDynamics
from mckinematics.text import degrees_text, millimetres_text

from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.text.profile_words import Action
from mcserver.gcode.text.syntax import Command
from mcserver.motion.geometry.curves import Array, Curve
from mcserver.motion.geometry.torque_limits import APART, HOLDING_SHARE, MOST_SAMPLES
from mcserver.units import AxisType

# Shares of a path at which the joints' positions are sampled.
PROBES = np.linspace(0.0, 1.0, 17)


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
    travel = np.abs(np.diff(_joints(dynamics, moved, before, PROBES), axis=0)).sum(axis=0).max()
    s = np.linspace(0.0, 1.0, min(2 + math.ceil(float(travel) / APART), MOST_SAMPLES))
    joints = _joints(dynamics, moved, before, s)
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


def _joints(dynamics: JointDynamics, curves: list[Curve], before: Mapping[int, float], s: Array) -> Array:
    """Return the joint positions of the dynamics model at shares of a path, shape (n, J)."""
    found = np.tile([before[axis] for axis in dynamics.axes], (len(s), 1))
    for curve in curves:
        position = curve.position(s)
        for column, axis in enumerate(curve.axes):
            if axis in dynamics.axes:
                found[:, dynamics.axes.index(axis)] = position[:, column]
    return found
