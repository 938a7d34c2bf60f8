"""From sparse knots to a joint path that keeps the tool on its path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.newton import joint_slope, newton
from kinematics.pose import Array
from kinematics.spline import clamped_spline, evaluate_cells
from kinematics.target_path import TargetPath
from kinematics.tool import LOOSE_SHARE, ToolModel

# share of the tolerance that is used: the rest is for what lies between the points that are checked
TOLERANCE_SHARE = 0.2
# where in each cell the tool is checked against its path
CHECKED_SHARES = np.array([0.2, 0.5, 0.8])
LARGEST_KNOT_COUNT = 200_000
SMALLEST_CELL = 1e-7
MOST_PIECES = 16
ROUNDS = 12
# rounds without the error falling to a half after which more knots are no help
STALLED_ROUNDS = 2


@dataclass(frozen=True)
class Fit:
    """A fitted spline: knots (M,), coefficients (4, M-1, K).

    ``failed_at`` is the s where no spline follows the path closely enough, None if all of it is followed.
    """

    knots: Array
    coefficients: Array
    failed_at: float | None


def fit(tool: ToolModel, path: TargetPath, s: Array, joints: Array, aside: float = 0.0) -> Fit:
    """Spline through rough positions ``joints`` (n, K) at ``s`` (n,), the first of them exact.

    ``aside``: as in `joint_slope`, the same as the positions were found with.

    Knots are added where the tool would leave its path by more than TOLERANCE_SHARE of its tolerance. The
    error of a cubic spline falls with the fourth power of the distance of its knots.
    """
    knots = s
    start = joints[0]
    targets = path.at(knots[1:])
    solved, ok = newton(tool, joints[1:], targets)
    values = np.concatenate([start[None], solved])
    slopes = _end_slopes(tool, path, values, aside)
    coefficients = clamped_spline(knots, values, *slopes)
    failed = ~ok
    if failed.any():
        return Fit(knots, coefficients, float(knots[1:][failed][0]))
    stalled, last = 0, np.inf
    for _ in range(ROUNDS):
        at, between = evaluate_cells(knots, coefficients, CHECKED_SHARES)
        excess = _excess(tool, path, at, between)
        bad = np.flatnonzero(~(excess <= 1.0))
        if not len(bad):
            return Fit(knots, coefficients, None)
        worst = float(knots[bad[0]])
        stalled = stalled + 1 if excess.max() > 0.5 * last else 0
        last = float(excess.max())
        if stalled == STALLED_ROUNDS:
            return Fit(knots, coefficients, worst)
        width = np.diff(knots)[bad]
        pieces = np.ceil(np.minimum(1.2 * excess[bad] ** 0.25, MOST_PIECES)).astype(int).clip(2)
        if width.min() < SMALLEST_CELL or len(knots) + int(pieces.sum()) > LARGEST_KNOT_COUNT:
            return Fit(knots, coefficients, worst)
        cell = np.repeat(bad, pieces - 1)
        share = np.concatenate([np.arange(1, count) / count for count in pieces])
        offset = share * np.diff(knots)[cell]
        x = offset[:, None]
        c3, c2, c1, c0 = coefficients[:, cell]
        guess = ((c3 * x + c2) * x + c1) * x + c0
        added = knots[cell] + offset
        solved, ok = newton(tool, guess, path.at(added))
        if not ok.all():
            return Fit(knots, coefficients, float(added[~ok][0]))
        knots = np.insert(knots, cell + 1, added)
        values = np.insert(values, cell + 1, solved, axis=0)
        coefficients = clamped_spline(knots, values, *slopes)
    return Fit(knots, coefficients, worst)


def _excess(tool: ToolModel, path: TargetPath, at: Array, joints: Array) -> Array:
    """Greatest error in each cell over what is allowed there, shape (M-1,) [1]."""
    cells, shares, size = joints.shape
    residual = tool.residual(joints.reshape(-1, size), path.at(at.ravel()))
    relative = np.linalg.norm(residual[:, :3], axis=1) / tool.tolerance
    if tool.orientation:
        turned = np.linalg.norm(residual[:, 3:], axis=1) / tool.tolerance_angle
        relative = np.maximum(relative, turned)
    # a chain with too few joints is off its knots already
    allowed = TOLERANCE_SHARE + (LOOSE_SHARE if tool.rank < tool.rows else 0.0)
    worst: Array = relative.reshape(cells, shares).max(axis=1) / allowed
    return worst


def _end_slopes(tool: ToolModel, path: TargetPath, values: Array, aside: float) -> tuple[Array, Array]:
    ends = np.array([0.0, 1.0])
    joints = values[[0, -1]]
    jacobians = tool.linearise(joints, path.at(ends))[1]
    start, end = joint_slope(tool, joints, jacobians, path.rates(ends), aside)
    return start, end
