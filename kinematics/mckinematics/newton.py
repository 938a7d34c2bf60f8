"""Newton's method on many poses at once."""

from __future__ import annotations

import numpy as np

from mckinematics.pose import Array, BoolArray
from mckinematics.tool import Targets, ToolModel

# a residual or step below these is down to rounding
RESIDUAL_FLOOR = 1e-12
STEP_FLOOR = 1e-10
# singular values below this share of the largest are damped
DAMPED_BELOW = 1e-3
LARGEST_GAIN = 1e4
# inverse Jacobians are kept as long as each step brings the residual below this share
CHORD_GAIN = 0.1
ITERATIONS = 10


def joint_step(tool: ToolModel, jacobians: Array, rates: Array) -> Array:
    """Joint changes of least norm for tool changes: J⁺·rate.

    Args:
        jacobians: shape (n, rows, K). rates: shape (n, rows), changes of the tool [m, rad].

    Returns:
        Shape (n, K). Directions that the chain never has (`ToolModel.rank`) are left out; close to a
        singular position steps are damped (Nakamura, Hanafusa), so that they stay bounded.
    """
    if tool.square:
        try:
            steps: Array = np.asarray(np.linalg.solve(jacobians, rates[..., None])[..., 0], dtype=np.float64)
        except np.linalg.LinAlgError:
            pass
        else:
            # a step that is far larger than the change asked for, or nan, is that of a singular matrix
            if np.abs(steps).max() <= largest_gain(tool) * np.abs(rates).max():
                return steps
    left, values, right = np.linalg.svd(jacobians, full_matrices=False)
    left, values, right = left[..., : tool.rank], values[..., : tool.rank], right[..., : tool.rank, :]
    floor = DAMPED_BELOW * values[..., :1] + 1e-12
    damping = np.where(values < floor, (1.0 - (values / floor) ** 2) * floor**2, 0.0)
    along = (left.swapaxes(-1, -2) @ rates[..., None])[..., 0]
    damped: Array = (right.swapaxes(-1, -2) @ (along * values / (values**2 + damping))[..., None])[..., 0]
    return damped


def largest_gain(tool: ToolModel) -> float:
    """Return how much larger than the change asked for a step may be; beyond it the matrix counts as
    singular.
    """
    return LARGEST_GAIN * max(1.0, 1.0 / tool.chain.reach)


def joint_slope(tool: ToolModel, joints: Array, jacobians: Array, rates: Array, aside: float) -> Array:
    """Joint velocities along a path: J⁺·rate, and of a chain with joints to spare a motion of those.

    Args:
        joints: shape (n, K). jacobians: shape (n, rows, K). rates: shape (n, rows), of the tool.
        aside: how strongly the joints are moved away from their limits where that does not move the tool
            (`ToolModel.spare_goal`); 0: not at all.

    Returns:
        Shape (n, K).
    """
    goal = tool.spare_goal(joints, aside)
    if goal is None:
        return joint_step(tool, jacobians, rates)
    spare = tool.tool_speed(rates)[:, None] * goal
    return joint_step(tool, jacobians, rates - (jacobians @ spare[..., None])[..., 0]) + spare


def newton(tool: ToolModel, joints: Array, targets: Targets) -> tuple[Array, BoolArray]:
    """Return joint positions for poses, from guesses near by; joint limits are not looked at.

    The inverse Jacobians are kept while they do well (the chord method): forward kinematics alone is far
    quicker, and guesses this near lose little by it.

    Args:
        joints: shape (n, K), the guesses [rad or m].

    Returns:
        The solutions, shape (n, K), and which of them reach their pose, shape (n,).
    """
    residual, jacobians = tool.linearise(joints, targets)
    inverse = _inverse(tool, jacobians)
    size = np.abs(residual).max()
    for _ in range(ITERATIONS):
        if size < RESIDUAL_FLOOR:
            return joints.copy(), np.ones(len(joints), dtype=bool)
        step = joint_step(tool, jacobians, residual) if inverse is None else _apply(inverse, residual)
        joints = joints + step
        if np.abs(step).max() < STEP_FLOOR:
            reached = tool.reached(residual)
            if inverse is not None and reached.all():
                # an undamped step this small leaves less than there was before it
                return joints, reached
            break
        last = size
        if inverse is not None:
            residual = tool.residual(joints, targets)
            size = np.abs(residual).max()
            if size <= CHORD_GAIN * last:
                continue
        residual, jacobians = tool.linearise(joints, targets)
        inverse = _inverse(tool, jacobians)
        size = np.abs(residual).max()
    return joints, tool.reached(tool.residual(joints, targets))


def _inverse(tool: ToolModel, jacobians: Array) -> Array | None:
    """Return the Jacobians' inverses where all are far from singular, else None."""
    if not tool.square:
        return None
    try:
        inverse: Array = np.asarray(np.linalg.inv(jacobians), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    return inverse if np.abs(inverse).max() <= largest_gain(tool) else None


def _apply(inverse: Array, residual: Array) -> Array:
    steps: Array = (inverse @ residual[..., None])[..., 0]
    return steps
