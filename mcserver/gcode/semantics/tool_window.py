"""Refuse moves of a tool that its leader may take out of reach or travel (D-145)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from mckinematics.errors import KinematicsError

from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.tool_moves import report_unsolved
from mcserver.gcode.text.profile_words import Action
from mcserver.gcode.text.syntax import Command
from mcserver.motion.geometry.curves import Curve

# Between places of a path that are looked at joints turn by this at the most, in so many places [rad or m].
APART = 0.2
MOST_PLACES = 17


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
        joints = np.tile([before[axis] for axis in tool.axes], (MOST_PLACES, 1))
        shares = np.linspace(0.0, 1.0, MOST_PLACES)
        for curve in moved:
            places = curve.position(shares)
            for column, axis in enumerate(curve.axes):
                if axis in tool.axes:
                    joints[:, tool.axes.index(axis)] = places[:, column]
        travel = float(np.abs(np.diff(joints, axis=0)).sum(axis=0).max())
        count = min(max(math.ceil(travel / APART), 1), MOST_PLACES - 1)
        looked = np.linspace(0, MOST_PLACES - 1, count + 1).round().astype(int)[1:]
        x, y, z = follow.direction
        window = (follow.superimposed.low, follow.superimposed.high)
        try:
            assert kinematics is not None
            kinematics.check_beside(tool.number, joints[looked], shares[looked], (x, y, z), window)
        except KinematicsError as error:
            report_unsolved(block, command, tool.number, error)
