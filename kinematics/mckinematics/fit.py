"""From sparse knots to a joint path that keeps the tool on its path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mckinematics.newton import joint_slope, newton
from mckinematics.pose import Array
from mckinematics.single import solve_two
from mckinematics.spline import clamped_spline, evaluate_cells
from mckinematics.target_path import Grid, TargetPath
from mckinematics.tool import LOOSE_SHARE, ToolModel
from mckinematics.trace import Trace

# share of the tolerance that is used: the rest is for what lies between the points that are checked
TOLERANCE_SHARE = 0.2
# where in each cell the tool is checked against its path
CHECKED_SHARES = np.array([0.2, 0.5, 0.8])
LARGEST_KNOT_COUNT = 200_000
SMALLEST_CELL = 1e-7
MOST_PIECES = 16
ROUNDS = 12
# how much less a fitted spline is off than the predictions; below 64, as a round costs more than some knots
EXTRAPOLATED = 24.0
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


def fit(tool: ToolModel, path: TargetPath, followed: Trace, grid: Grid, aside: float = 0.0) -> Fit:
    """Spline through the rough positions of a trace, the first of them exact.

    ``grid``, ``aside``: what the positions were found with.

    Knots are added where the tool would leave its path by more than TOLERANCE_SHARE of its tolerance. The
    error of a cubic spline falls with the fourth power of the distance of its knots.
    """
    knots, joints = _first_knots(followed)
    targets = grid.targets if len(knots) == len(grid.s) else path.at(knots)
    solved, ok = newton(tool, joints[1:], targets.rows(slice(1, None)))
    values = np.concatenate([joints[:1], solved])
    slopes = _end_slopes(tool, values, grid.rates, followed.end_slopes[0], aside)
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
        which, share = _inner(pieces)
        cell = bad[which]
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


def _first_knots(followed: Trace) -> tuple[Array, Array]:
    """Knots (n,) and rough joints (n, K), so dense that most paths need no more.

    The trace's predictions, cubics carried on by one cell, miss by the fourth derivative times h⁴/6; a spline
    that is fitted is off by h⁴/384 of it.
    """
    s, joints, slopes = followed.s, followed.joints, followed.slopes
    misses = followed.misses.copy()
    # the first prediction is a tangent alone
    misses[:1] = misses[:2].min()
    excess = misses / (EXTRAPOLATED * TOLERANCE_SHARE)
    pieces = np.ceil(excess**0.25).astype(int).clip(1, MOST_PIECES)
    if pieces.max() == 1:
        return s, joints
    cell, share = _inner(pieces)
    width = np.diff(s)[cell, None]
    x, rest = share[:, None], 1.0 - share[:, None]
    # Hermite's cubic of each cell
    guess = rest**2 * ((1.0 + 2.0 * x) * joints[cell] + x * width * slopes[cell])
    guess += x**2 * ((1.0 + 2.0 * rest) * joints[cell + 1] - rest * width * slopes[cell + 1])
    return np.insert(s, cell + 1, s[cell] + share * width[:, 0]), np.insert(joints, cell + 1, guess, axis=0)


def _inner(pieces: NDArray[np.int_]) -> tuple[NDArray[np.int_], Array]:
    """Places between the pieces of cells: the cell and the share of it, shape (sum of pieces - 1,) each."""
    count = pieces - 1
    cell = np.repeat(np.arange(len(pieces)), count)
    number = np.arange(len(cell)) - np.repeat(np.cumsum(count) - count, count) + 1
    return cell, number / pieces[cell]


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


def _end_slopes(
    tool: ToolModel, values: Array, rates: Array, start: Array | None, aside: float
) -> tuple[Array, Array]:
    if start is not None and tool.square and aside == 0.0:
        columns, rate = tool.chain.single.linearise(values[-1].tolist()).columns, rates[-1].tolist()
        end = solve_two(columns, rate, rate)
        if end is not None:
            return start, np.array(end[0])
    joints = values[[0, -1]]
    jacobians = tool.chain.jacobian(joints, tool.rows)[2]
    slopes = joint_slope(tool, joints, jacobians, rates[[0, -1]], aside)
    return slopes[0] if start is None else start, slopes[1]
