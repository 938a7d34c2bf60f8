"""Joint positions for a single pose, from near or far: damped least squares from many starts.

Levenberg-Marquardt (Nielsen's damping) on all starts at once; it ends at a solution or, for a pose out of
reach, at the nearest that the chain can do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mckinematics.newton import newton
from mckinematics.pose import Array, BoolArray
from mckinematics.tool import Targets, ToolModel

ITERATIONS = 80
# a share of the cost that is too little to go on for; of a distance that is missing it is half of this
SETTLED_GAIN = 1e-9
# largest change of a joint in one iteration [rad, or m per metre of reach]
LONGEST_MOVE = 0.7
LIMIT_SLACK = 1e-9
# as a share of the weighted normal matrix
LEAST_DAMPING = 1e-12


@dataclass(frozen=True)
class SearchResult:
    """Ends of a search: joints (n, K), residuals (n, rows), and which of them reach the pose (n,)."""

    joints: Array
    residuals: Array
    reached: BoolArray


def search(
    tool: ToolModel,
    target: Targets,
    starts: Array,
    *,
    limited: bool = False,
    point_weight: float = 1.0,
    turn_weight: float = 1.0,
    iterations: int = ITERATIONS,
) -> SearchResult:
    """Solutions or nearest positions for one pose from each of ``starts`` (n, K).

    Args:
        limited: keep the joints within their limits on the way; else limits are not looked at.
        point_weight, turn_weight: what counts more where a pose is out of reach.
    """
    chain = tool.chain
    joints = np.clip(starts, chain.lower, chain.upper) if limited else starts.copy()
    count, size = joints.shape
    targets = Targets(
        np.repeat(target.positions, count, axis=0),
        None if target.rotations is None else np.repeat(target.rotations, count, axis=0),
    )
    unit = tool.unit
    scale = np.full(tool.rows, turn_weight)
    scale[:3] = point_weight / chain.reach
    # with joints to spare the matrix is singular without it, to the precision that its weights leave
    least = LEAST_DAMPING * max(point_weight, turn_weight, 1.0) ** 2
    damping = np.full(count, 1e-3)
    growth = np.full(count, 2.0)
    residual, jacobian = tool.linearise(joints, targets)
    cost = ((residual * scale) ** 2).sum(axis=1)
    active = np.ones(count, dtype=bool)
    identity = np.eye(size)
    for _ in range(iterations):
        rows = np.flatnonzero(active)
        if not len(rows):
            break
        weighted = jacobian[rows] * scale[:, None] * unit
        gradient = (weighted.swapaxes(1, 2) @ (residual[rows] * scale)[..., None])[..., 0]
        if limited:
            # a joint at its limit that would go on beyond it is left out
            blocked = (joints[rows] <= chain.lower) & (gradient < 0.0)
            blocked |= (joints[rows] >= chain.upper) & (gradient > 0.0)
            weighted = np.where(blocked[:, None, :], 0.0, weighted)
            gradient = np.where(blocked, 0.0, gradient)
        normal = weighted.swapaxes(1, 2) @ weighted + damping[rows, None, None] * identity
        move = np.linalg.solve(normal, gradient[..., None])[..., 0]
        longest = np.abs(move).max(axis=1, keepdims=True)
        move *= np.minimum(1.0, LONGEST_MOVE / np.maximum(longest, 1e-300))
        tried = joints[rows] + move * unit
        if limited:
            tried = np.clip(tried, chain.lower, chain.upper)
        new_residual, new_jacobian = tool.linearise(tried, targets.rows(rows))
        new_cost = ((new_residual * scale) ** 2).sum(axis=1)
        better = new_cost < cost[rows]
        gained = cost[rows] - new_cost
        taken = rows[better]
        joints[taken] = tried[better]
        residual[taken], jacobian[taken] = new_residual[better], new_jacobian[better]
        cost[taken] = new_cost[better]
        damping[rows] = np.where(better, np.maximum(damping[rows] / 5.0, least), damping[rows] * growth[rows])
        growth[rows] = np.where(better, 2.0, np.minimum(2.0 * growth[rows], 1e3))
        settled = (
            (cost[rows] < 1e-20) | (damping[rows] > 1e8) | (better & (gained < SETTLED_GAIN * cost[rows]))
        )
        active[rows[settled]] = False
    close = cost < 1e-8
    if close.any():
        polished, ok = newton(tool, joints[close], targets.rows(close))
        moved = np.abs((polished - joints[close]) / unit).max(axis=1)
        keep = ok & (moved < 0.1)
        if limited:
            keep &= within_limits(tool, polished)
        joints[np.flatnonzero(close)[keep]] = polished[keep]
    residual = tool.residual(joints, targets)
    return SearchResult(joints, residual, tool.reached(residual))


def within_limits(tool: ToolModel, joints: Array) -> BoolArray:
    """Return which rows of ``joints`` (n, K) keep every joint limit, shape (n,)."""
    chain = tool.chain
    inside = (joints >= chain.lower - LIMIT_SLACK) & (joints <= chain.upper + LIMIT_SLACK)
    return np.asarray(inside.all(axis=1))


def unwind(tool: ToolModel, joints: Array, near: Array) -> Array:
    """The same poses, each turning joint moved by full turns towards ``near``, within its limits if it can.

    Args:
        joints: shape (n, K). near: shape (K,).
    """
    chain = tool.chain
    turn = 2.0 * np.pi
    turns = np.round((near - joints) / turn)
    wound = joints + turn * turns
    with np.errstate(invalid="ignore"):
        least = np.ceil((chain.lower - LIMIT_SLACK - joints) / turn)
        most = np.floor((chain.upper + LIMIT_SLACK - joints) / turn)
    fits = least <= most
    bounded = joints + turn * np.clip(turns, least, np.maximum(least, most))
    result: Array = np.where(chain.revolute, np.where(fits, bounded, wound), joints)
    return result
