"""Following a tool's path from its start: numerical continuation with step control.

Each step predicts the joints ahead from the last two positions and their slopes and corrects them by
Newton's method. Only a correction that stays close to the prediction is taken, so the joint path never
changes over to another configuration of the chain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.newton import joint_slope, joint_step
from kinematics.pose import Array
from kinematics.target_path import TargetPath
from kinematics.tool import Targets, ToolModel

# a correction or step beyond these means that the step was too long [rad, or m per metre of reach]
LARGEST_CORRECTION = 0.25
LARGEST_STEP = 0.6
# rough is enough here, as all positions are polished together afterwards: after a step of this size the
# error left is its square [rad; m, rad]
SETTLED_STEP = 0.03
ROUGH_RESIDUAL = 1e-7
CORRECTIONS = 4
# halvings of the grid's step before the path counts as ended
HALVINGS = 12


@dataclass(frozen=True)
class Trace:
    """What was followed: s of shape (n,), joints of shape (n, K); ``complete`` if s reaches 1."""

    s: Array
    joints: Array
    complete: bool


@dataclass(frozen=True)
class _Place:
    s: float
    joints: Array
    slope: Array


def trace(tool: ToolModel, path: TargetPath, start: Array, cells: int, aside: float = 0.0) -> Trace:
    """Rough joint positions along the path from ``start``, shape (K,), as far as they can be followed.

    ``cells``: steps of 1/cells are the longest. ``aside``: as in `joint_slope`.
    """
    grid = np.linspace(0.0, 1.0, cells + 1)
    targets, rates = path.at(grid), path.rates(grid)
    unit = tool.unit
    jacobian = tool.linearise(start[None], targets.rows(slice(0, 1)))[1]
    slope = joint_slope(tool, start[None], jacobian, rates[:1], aside)[0]
    here, before = _Place(0.0, start, slope), None
    places = [here]
    # steps are counted in the finest ones, so that halving and doubling are exact
    finest = 1 << HALVINGS
    at, stride, last = 0, finest, cells * finest
    while at < last:
        ahead = at + stride
        cell, rest = divmod(ahead, finest)
        if rest:
            s = np.array([ahead / last])
            target, rate = path.at(s), path.rates(s)
        else:
            target, rate = targets.rows(slice(cell, cell + 1)), rates[cell : cell + 1]
        guess = _predict(tool, here, before, ahead / last)
        reached = None
        if np.abs((guess - here.joints) / unit).max() <= LARGEST_STEP:
            reached = _correct(tool, guess, target, rate, aside)
        if reached is None:
            stride //= 2
            if stride == 0:
                break
            continue
        before, here = here, _Place(ahead / last, *reached)
        places.append(here)
        at = ahead
        if stride < finest and at % (2 * stride) == 0:
            stride *= 2
    return Trace(
        np.array([place.s for place in places]),
        np.array([place.joints for place in places]),
        at == last,
    )


def _predict(tool: ToolModel, here: _Place, before: _Place | None, s: float) -> Array:
    step = s - here.s
    tangent: Array = here.joints + step * here.slope
    # far ahead of a short step a polynomial is worse than the tangent
    if before is None or step > 2.0 * (here.s - before.s):
        return tangent
    width = here.s - before.s
    if tool.chain.size > tool.rank:
        # joints to spare: no correction holds them, so the rule has to be stable by itself (Adams, Bashforth)
        stable: Array = tangent + step**2 / (2.0 * width) * (here.slope - before.slope)
        return stable
    # the cubic through the last two places and their slopes, carried on; the correction keeps it stable
    secant = (here.joints - before.joints) / width
    second = (here.slope - secant) / width
    third = (here.slope + before.slope - 2.0 * secant) / width**2
    cubic: Array = tangent + step**2 * (second + (step + width) * third)
    return cubic


def _correct(
    tool: ToolModel, guess: Array, target: Targets, rate: Array, aside: float
) -> tuple[Array, Array] | None:
    """The joints at a target and their slope, from a guess; None if the guess is not safely near."""
    unit = tool.unit
    joints = guess[None]
    for _ in range(CORRECTIONS):
        residual, jacobian = tool.linearise(joints, target)
        if aside == 0.0:
            step, slope = joint_step(tool, jacobian, np.concatenate([residual, rate]))
        else:
            step = joint_step(tool, jacobian, residual)[0]
            slope = joint_slope(tool, joints, jacobian, rate, aside)[0]
        joints = joints + step
        if np.abs((joints[0] - guess) / unit).max() > LARGEST_CORRECTION:
            return None
        if np.abs(step / unit).max() > SETTLED_STEP:
            continue
        # damping near a singular position makes steps small that do not close the gap
        left = np.abs(residual[0] - jacobian[0] @ step).max()
        if left <= max(0.1 * np.abs(residual).max(), ROUGH_RESIDUAL) or tool.rank < tool.rows:
            return joints[0], slope
    return None
