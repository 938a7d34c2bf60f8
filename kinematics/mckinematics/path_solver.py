"""A whole tool path: the joint path that keeps the tool on it, or why no such path exists (D-53, D-54)."""

from __future__ import annotations

import contextlib

import numpy as np

from mckinematics import refusal
from mckinematics.errors import JointLimit, KinematicsError
from mckinematics.fit import Fit, fit
from mckinematics.fold import folds
from mckinematics.newton import newton
from mckinematics.pose import Array, JointPath, ToolPath
from mckinematics.pose_solver import missing, missing_within_limits
from mckinematics.search import LIMIT_SLACK, within_limits
from mckinematics.spline import spline_extremes, spline_hull
from mckinematics.target_path import Grid, TargetPath
from mckinematics.tool import ToolModel
from mckinematics.trace import Trace, trace

# joints that move this much faster than the tool (lengths over the reach) are wild: refused. A leg of two
# equal parts that is stretched comes to this with its knee bent by 0.2°, 2 ppm short of its full length.
LARGEST_GAIN = 1e3
CLEAR_GAIN = 50.0
# what is lost below this smallest singular value is lost to a singular position
SINGULAR_BELOW = 0.03
# a path is traced again this much finer where knots between the first ones are not found
REFINEMENTS = (4, 16)
MOST_CELLS = 1 << 16
# how strongly a chain with joints to spare moves them away from limits, once one would be passed
ASIDE = 4.0
# points of the rest of a path that are tried to see how far it leaves the reach, and what counts there [m]
PROBES = 7
MISSING_FLOOR = 1e-7
# how far behind a fold it is looked whether the path can be reached there
BEYOND = 2e-3


def solve_tool_path(tool: ToolModel, path: ToolPath, joints: Array) -> JointPath:
    """Joint path from ``joints``, shape (K,), along the tool's path.

    Raises:
        ModelError: the joints are not at the path's start.
        Unreachable, JointLimit, Singular, BranchJump: as their names say; nothing is clipped.
    """
    targets = TargetPath(tool, path, joints)
    try:
        return _solve(tool, targets, joints, 0.0)
    except JointLimit:
        if tool.chain.size == tool.rank:
            raise
        # the plain path's fault is the one to tell if this does not help
        with contextlib.suppress(KinematicsError):
            return _solve(tool, targets, joints, ASIDE)
        raise


def _solve(tool: ToolModel, targets: TargetPath, joints: Array, aside: float) -> JointPath:
    grid = targets.grid()
    followed, fitted = _follow(tool, targets, joints, grid, aside)
    for finer in REFINEMENTS:
        if fitted.failed_at is None:
            break
        cells = targets.even_grid(min(finer * grid.cells, MOST_CELLS))
        followed, fitted = _follow(tool, targets, joints, cells, aside)
    if fitted.failed_at is not None:
        raise _lost(tool, targets, followed, fitted.failed_at)
    _refuse_limits(tool, targets, fitted.knots, fitted.coefficients)
    # slopes within the spline are the joints' own; where they are small nothing is singular
    slopes = tool.joint_speed(fitted.coefficients[2])
    if slopes.max() > CLEAR_GAIN * tool.tool_speed(grid.rates).max():
        _refuse_singular(tool, targets, followed, fitted.knots[:-1], fitted.coefficients[3])
    return JointPath(tool.chain.axes, fitted.knots, fitted.coefficients)


def _follow(
    tool: ToolModel, targets: TargetPath, joints: Array, grid: Grid, aside: float
) -> tuple[Trace, Fit]:
    followed = trace(tool, targets, joints, grid, aside)
    start, end = followed.end_slopes
    # from a singular start both sides of it look the same, so that nothing beyond it is to be relied on
    if not _tame(tool, start, grid.rates[:1]):
        _refuse_singular(tool, targets, followed.begun(), followed.s[:1], followed.joints[:1])
    if not followed.complete:
        raise _lost(tool, targets, followed, float(followed.s[-1]))
    # no spline comes to an end that is singular
    if not _tame(tool, end, grid.rates[-1:]):
        _refuse_singular(tool, targets, followed, followed.s[-1:], followed.joints[-1:])
    return followed, fit(tool, targets, followed, grid, aside)


def _tame(tool: ToolModel, slope: Array | None, rates: Array) -> bool:
    """Return whether an exact slope (K,) of the joints is known to be none of wild joints."""
    if slope is None:
        return False
    return float(tool.joint_speed(slope[None])[0]) <= LARGEST_GAIN * float(tool.tool_speed(rates)[0])


def _refuse_singular(tool: ToolModel, targets: TargetPath, followed: Trace, s: Array, joints: Array) -> None:
    """Refuse a path whose joints are wild at one of these places, s (n,) and joints (n, K)."""
    jacobians = tool.linearise(joints, targets.at(s))[1]
    wild = tool.joint_gain(jacobians, targets.rates(s)) > LARGEST_GAIN
    if wild.any():
        raise _lost(tool, targets, followed, float(s[wild][0]))


def _refuse_limits(tool: ToolModel, targets: TargetPath, knots: Array, coefficients: Array) -> None:
    chain = tool.chain
    low, high = spline_hull(knots, coefficients)
    if (low >= chain.lower).all() and (high <= chain.upper).all():
        return
    low, high = spline_extremes(knots, coefficients)
    excess = np.maximum(chain.lower - low, high - chain.upper)
    bad = np.argwhere(excess > LIMIT_SLACK)
    if not len(bad):
        return
    cell = int(bad[0, 0])
    column = int(np.argmax(np.where(excess[cell] > LIMIT_SLACK, excess[cell], -np.inf)))
    below = chain.lower[column] - low[:, column] >= high[:, column] - chain.upper[column]
    # the value is the worst of this crossing: of the cells from here on that are past the same limit
    inside = np.flatnonzero((excess[cell:, column] <= LIMIT_SLACK) | (below[cell:] != below[cell]))
    last = cell + int(inside[0]) if len(inside) else len(low)
    value = low[cell:last, column].min() if below[cell] else high[cell:last, column].max()
    limits = float(chain.lower[column]), float(chain.upper[column])
    s = _crossing(knots, coefficients[:, :, column], cell, limits)
    left = missing_within_limits(tool, targets.at(np.ones(1)), coefficients[3, -1])
    raise refusal.joint_limit(tool, column, float(value), targets.at(np.array([s])).positions[0], s, left)


def _crossing(knots: Array, coefficients: Array, cell: int, limits: tuple[float, float]) -> float:
    x = np.linspace(0.0, knots[cell + 1] - knots[cell], 65)
    value = np.polyval(coefficients[:, cell], x)
    past = np.flatnonzero((value < limits[0] - LIMIT_SLACK) | (value > limits[1] + LIMIT_SLACK))
    return float(knots[cell] + (x[past[0]] if len(past) else x[0]))


def _lost(tool: ToolModel, targets: TargetPath, followed: Trace, s: float) -> KinematicsError:
    """Why a path cannot be followed beyond s."""
    place = targets.at(np.array([s])).positions[0]
    nearby = int(np.argmin(np.abs(followed.s - s)))
    residual = _furthest(tool, targets, s, followed.joints[nearby])
    if residual is not None:
        return refusal.unreachable(tool, residual, place, s)
    known = followed.s <= s
    solved, _ = newton(tool, followed.joints[known], targets.at(followed.s[known]))
    past = ~within_limits(tool, solved)
    if past.any():
        first = int(np.argmax(past))
        excess = np.maximum(tool.chain.lower - solved[first], solved[first] - tool.chain.upper)
        column = int(np.argmax(excess))
        limit_s = followed.s[first : first + 1]
        limit_place = targets.at(limit_s).positions[0]
        left = missing_within_limits(tool, targets.at(np.ones(1)), solved[first])
        value = float(solved[first, column])
        return refusal.joint_limit(tool, column, value, limit_place, float(limit_s[0]), left)
    # a spline gives up a little before the position that it cannot follow
    ahead = slice(max(0, nearby - 1), None)
    conditioning = tool.conditioning(tool.linearise(followed.joints[ahead], targets.at(followed.s[ahead]))[1])
    worst = int(np.argmin(conditioning))
    if conditioning[worst] < SINGULAR_BELOW:
        at = followed.s[ahead][worst : worst + 1]
        end = _beyond_fold(tool, targets, float(at[0]), followed.joints[ahead][worst])
        if end is not None:
            return end
        return refusal.singular(tool, float(conditioning[worst]), targets.at(at).positions[0], float(at[0]))
    return refusal.branch_jump(tool, place, s)


def _beyond_fold(tool: ToolModel, targets: TargetPath, s: float, joints: Array) -> KinematicsError | None:
    """What keeps a path from going on from a fold at s; None if there is no fold, or the path ends in it.

    At a fold the configuration that the joints are in meets another one, and beyond it neither is there: the
    path goes on in a third one, or nowhere.
    """
    beyond = s + BEYOND
    if s == 0.0 or beyond >= 1.0 or not folds(tool, joints, targets.rates(np.array([s]))):
        return None
    pose = targets.at(np.array([beyond]))
    residual = missing(tool, pose, joints)
    place = targets.at(np.array([s])).positions[0]
    if _size(tool, residual) > MISSING_FLOOR:
        return refusal.unreachable(tool, residual, place, s)
    return refusal.branch_jump(tool, place, s)


def _furthest(tool: ToolModel, targets: TargetPath, s: float, joints: Array) -> Array | None:
    """Return what is missing where the path beyond s is furthest out of reach, its end first; None if
    nothing is.
    """

    def missing_at(share: float) -> Array:
        pose = targets.at(np.array([s + (1.0 - s) * share]))
        return missing(tool, pose, joints)

    end = missing_at(1.0)
    if _size(tool, end) > MISSING_FLOOR:
        return end
    between = [missing_at(float(share)) for share in np.linspace(0.0, 1.0, PROBES + 2)[1:-1]]
    worst = max(between, key=lambda residual: _size(tool, residual))
    return worst if _size(tool, worst) > MISSING_FLOOR else None


def _size(tool: ToolModel, residual: Array) -> float:
    """Return a residual as one length: a turn counts as its arc at the chain's reach [m]."""
    return float(np.linalg.norm(residual[:3]) + tool.chain.reach * np.linalg.norm(residual[3:]))
