"""One pose after the other, as they come: the joints that go on to each from where the last one left them."""

from __future__ import annotations

import math

import numpy as np

from mckinematics.errors import KinematicsError
from mckinematics.newton import joint_slope
from mckinematics.pose import Array, Pose, ToolPath
from mckinematics.rotation import matrix_to_euler
from mckinematics.search import within_limits
from mckinematics.single import Floats
from mckinematics.target_path import TargetPath
from mckinematics.tool import Targets, ToolModel
from mckinematics.trace import LARGEST_CORRECTION, Goal, largest_change, linear_step, trace

# Newton's steps to a pose near by, and the one behind which nothing is left: its square [rad]
STEPS, SETTLED = 6, 1e-4
# the same where setpoints follow from it, whose jerk is to be smooth
EXACT = 1e-6
# how strongly joints to spare are moved away from a limit that they would pass
ASIDE = 4.0
# share of a twist that a singular position may take away
LOST = 0.1


def solve_near(tool: ToolModel, target: Targets, joints: Array) -> Array | None:
    """Joints, shape (K,), at one pose that is close to ``joints``; None: it is not, or past a limit.

    No joint goes further than a configuration reaches (`LARGEST_CORRECTION`), so the chain never changes over
    to another one. Joints to spare go to the tool's posture by what the tool travels.
    """
    found = _newton(tool, target, joints, 0.0)
    if found is not None and not within_limits(tool, found[None])[0] and tool.chain.size > tool.rank:
        found = _newton(tool, target, joints, ASIDE)
    return found if found is not None and within_limits(tool, found[None])[0] else None


def _newton(tool: ToolModel, target: Targets, joints: Array, aside: float) -> Array | None:
    turned = None if target.rotations is None else target.rotations.ravel().tolist()
    goal = Goal(target.positions[0].tolist(), turned, (0.0,) * tool.rows)
    start = joints.tolist()
    guess = start
    if tool.posture is not None or aside:
        residual, jacobian = tool.linearise(joints[None], target)
        guess = (joints + joint_slope(tool, joints[None], jacobian, residual, aside)[0]).tolist()
    found = solve_goal(tool, guess, goal, start=start, settled=SETTLED)
    return None if found is None else np.array(found[0])


def solve_goal(
    tool: ToolModel, guess: Floats, goal: Goal, *, start: Floats | None = None, settled: float = EXACT
) -> tuple[list[float], list[float]] | None:
    """Joints at a goal near a guess and their slope there, K numbers each; None: it is not near.

    Args:
        start: from which no joint goes further than `LARGEST_CORRECTION`; None: the guess. settled: the step
            behind which nothing is left but its square [rad].
    """
    start, units = guess if start is None else start, tool.unit.tolist()
    found = list(guess)
    for _ in range(STEPS):
        linear = linear_step(tool, found, goal, 0.0)
        found = [joint + change for joint, change in zip(found, linear.step, strict=True)]
        # a step that is no number is not below the bound either
        if not largest_change(found, start, units) <= LARGEST_CORRECTION:
            return None
        if linear.closes and largest_change(linear.step, (0.0,) * len(found), units) <= settled:
            # a chain with too few joints comes to rest beside what it cannot reach
            loose = tool.rank < tool.rows
            return (found, linear.slope) if not loose or _reached(tool, found, goal) else None
    return None


def _reached(tool: ToolModel, joints: Floats, goal: Goal) -> bool:
    turned = None if goal.rotation is None else np.array(goal.rotation).reshape(1, 3, 3)
    residual = tool.residual(np.array([joints]), Targets(np.array([goal.position]), turned))
    return bool(tool.reached(residual)[0])


def solve_along_line(tool: ToolModel, pose: Pose, joints: Array) -> Array | None:
    """Joints at a pose further away, reached on the straight line to it; None: it is not reached so."""
    positions, rotations = tool.chain.forward(joints[None])
    start, end = positions[0], np.array(pose.position)
    angles = matrix_to_euler(rotations[0], tool.euler) if tool.orientation else None
    line = ToolPath.straight(start, end - start, angles, pose.angles if tool.orientation else None)
    try:
        path = TargetPath(tool, line, joints)
        followed = trace(tool, path, joints, path.grid())
    except KinematicsError:
        return None
    if not followed.complete or not within_limits(tool, followed.joints).all():
        return None
    return solve_near(tool, tool.target(pose), followed.joints[-1])


def joint_rates(tool: ToolModel, joints: Array, twist: Array) -> tuple[Array, float]:
    """Rates of the joints, shape (K,), at which the tool moves at ``twist``, shape (rows,), along the base's
    axes; and how much faster than the tool they are [1], infinite where it cannot move so.

    Both without units (`ToolModel.unit`), as of `ToolModel.joint_gain`.
    """
    # of one position plain numbers are quicker than numpy's calls
    columns = tool.chain.single.linearise(joints.tolist()).columns
    jacobian = np.array(columns).T[: tool.rows]
    rates: Array = joint_slope(tool, joints[None], jacobian[None], twist[None], 0.0)[0]
    fastest = _size(twist / tool.row_unit)
    if fastest == 0.0:
        return rates, 0.0
    # damping and a chain of too few joints leave a part of it out
    lost = _size((twist - jacobian @ rates) / tool.row_unit)
    return rates, _size(rates / tool.unit) / fastest if lost <= LOST * fastest else np.inf


def _size(numbers: Array) -> float:
    return math.hypot(*numbers.tolist())
