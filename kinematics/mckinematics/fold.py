"""Folds: singular positions at which a configuration of the joints ends.

Where the smallest singular value of the Jacobian goes to zero, n its joints' direction and u the tool's, the
tool moves by ½·b·λ² along u when the joints move by λ along n, b = u·(∂J/∂n)·n. With b ≠ 0 the positions on
both sides of n belong to the same places of the tool, and none to places on the other side of u: two
configurations meet and end (a fold of the map from joints to poses; Whitney). With b = 0 the joints can move
along n while the tool stands still, as about aligned wrist axes.
"""

from __future__ import annotations

import numpy as np

from mckinematics.pose import Array
from mckinematics.tool import ToolModel, without_units

# the difference by which the Jacobian's change along n is taken [rad]
STEP = 1e-3
# how near the fold has to be along n: singular value over b [rad], and the least b [1]
NEAREST = 0.1
LEAST_BEND = 0.01
# share of the tool's rate that goes across the fold, at least
LEAST_CROSSING = 0.01


def folds(tool: ToolModel, joints: Array, rates: Array) -> bool:
    """Return whether a path with these rates, shape (1, rows), crosses a fold next to ``joints``, shape (K,).

    Only of chains with as many joints as the pose has numbers.
    """
    if not tool.square:
        return False
    left, values, right = np.linalg.svd(_jacobian(tool, joints))
    across, along = left[:, -1], right[-1]
    ahead = _jacobian(tool, joints + STEP * along * tool.unit)
    behind = _jacobian(tool, joints - STEP * along * tool.unit)
    bend = abs(float(across @ (ahead - behind) @ along)) / (2.0 * STEP)
    if bend < LEAST_BEND or values[-1] > NEAREST * bend:
        return False
    rate = rates[0].copy()
    rate[:3] /= tool.chain.reach
    return abs(float(across @ rate)) > LEAST_CROSSING * float(np.linalg.norm(rate))


def _jacobian(tool: ToolModel, joints: Array) -> Array:
    scaled: Array = without_units(tool.chain, tool.chain.jacobian(joints[None], tool.rows)[2])[0]
    return scaled
