"""Following a tool's path from its start: numerical continuation with step control.

Each step predicts the joints ahead from the last two positions and their slopes and corrects them by
Newton's method. Only a correction that stays close to the prediction is taken, so the joint path never
changes over to another configuration of the chain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mckinematics.newton import joint_slope, joint_step, largest_gain
from mckinematics.pose import Array
from mckinematics.single import Floats, small_turn, solve_two
from mckinematics.target_path import Grid, TargetPath
from mckinematics.tool import Targets, ToolModel

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
    """What was followed.

    Attributes:
        s: shape (n,). joints: shape (n, K). complete: whether s reaches 1.
        slopes: shape (n, K), as rough as the joints. misses: shape (n-1,), by how many of its
            tolerances the tool was off in the prediction of each place but the first.
        end_slopes: the joints' slopes at s = 0 and 1, shape (K,) each; None where they are not known
            exactly, as in a singular position.
    """

    s: Array
    joints: Array
    complete: bool
    slopes: Array
    misses: Array
    end_slopes: tuple[Array | None, Array | None] = (None, None)

    def begun(self) -> Trace:
        """Its first place alone."""
        return Trace(self.s[:1], self.joints[:1], False, self.slopes[:1], self.misses[:0])


@dataclass(frozen=True)
class _Place:
    s: float
    joints: Floats
    slope: Floats


@dataclass(frozen=True)
class Goal:
    """One target with its rate, as plain numbers; ``rotation`` row by row."""

    position: Floats
    rotation: Floats | None
    rate: Floats


@dataclass(frozen=True)
class _Reached:
    """A corrected place; ``miss``: the tool was off its goal by so many of its tolerances before."""

    joints: list[float]
    slope: list[float]
    miss: float

    def place(self, s: float) -> _Place:
        return _Place(s, self.joints, self.slope)


@dataclass(frozen=True)
class Linear:
    """``gap`` to a goal, ``step`` there, whether it ``closes`` the gap; ``slope``, ``exact``: not damped."""

    gap: Floats
    step: list[float]
    slope: list[float]
    closes: bool
    exact: bool


def trace(tool: ToolModel, path: TargetPath, start: Array, grid: Grid, aside: float = 0.0) -> Trace:
    """Rough joint positions along the path from ``start``, shape (K,), as far as they can be followed.

    ``grid``: its steps are the longest. ``aside``: as in `joint_slope`.
    """
    goals = _goals(grid.targets, grid.rates)
    units = tool.unit.tolist()
    first = start.tolist()
    begun = linear_step(tool, first, goals[0], aside)
    here, before = _Place(0.0, first, begun.slope), None
    places = [here]
    misses: list[float] = []
    # steps are counted in the finest ones, so that halving and doubling are exact
    finest = 1 << HALVINGS
    at, stride, last = 0, finest, grid.cells * finest
    while at < last:
        ahead = at + stride
        cell, rest = divmod(ahead, finest)
        s = ahead / last
        goal = _goal_at(path, s) if rest else goals[cell]
        guess = _predict(tool, here, before, s)
        reached = None
        if largest_change(guess, here.joints, units) <= LARGEST_STEP:
            reached = _correct(tool, guess, goal, aside, units)
        if reached is None:
            stride //= 2
            if stride == 0:
                break
            continue
        before, here = here, reached.place(s)
        places.append(here)
        misses.append(reached.miss)
        at = ahead
        if stride < finest and at % (2 * stride) == 0:
            stride *= 2
    complete = at == last
    ended = linear_step(tool, here.joints, goals[-1], aside) if complete else None
    return Trace(
        np.array([place.s for place in places]),
        np.array([place.joints for place in places]),
        complete,
        np.array([place.slope for place in places]),
        np.array(misses),
        (_exact_slope(begun), None if ended is None else _exact_slope(ended)),
    )


def _exact_slope(linear: Linear) -> Array | None:
    return np.array(linear.slope) if linear.exact else None


def _goal_at(path: TargetPath, s: float) -> Goal:
    place = np.array([s])
    return _goals(path.at(place), path.rates(place))[0]


def _goals(targets: Targets, rates: Array) -> list[Goal]:
    positions = targets.positions.tolist()
    rows = rates.tolist()
    if targets.rotations is None:
        return [Goal(position, None, rate) for position, rate in zip(positions, rows, strict=True)]
    rotations = targets.rotations.reshape(-1, 9).tolist()
    return [Goal(*each) for each in zip(positions, rotations, rows, strict=True)]


def _predict(tool: ToolModel, here: _Place, before: _Place | None, s: float) -> list[float]:
    step = s - here.s
    # far ahead of a short step a polynomial is worse than the tangent
    if before is None or step > 2.0 * (here.s - before.s):
        return [joint + step * slope for joint, slope in zip(here.joints, here.slope, strict=True)]
    width = here.s - before.s
    if tool.chain.size > tool.rank:
        # joints to spare: no correction holds them, so the rule has to be stable by itself (Adams, Bashforth)
        bend = step**2 / (2.0 * width)
        return [
            joint + step * slope + bend * (slope - earlier)
            for joint, slope, earlier in zip(here.joints, here.slope, before.slope, strict=True)
        ]
    # the cubic through the last two places and their slopes, carried on; the correction keeps it stable
    guess = []
    for joint, slope, old, earlier in zip(here.joints, here.slope, before.joints, before.slope, strict=True):
        secant = (joint - old) / width
        second = (slope - secant) / width
        third = (slope + earlier - 2.0 * secant) / width**2
        guess.append(joint + step * slope + step**2 * (second + (step + width) * third))
    return guess


def _correct(tool: ToolModel, guess: list[float], goal: Goal, aside: float, units: Floats) -> _Reached | None:
    """Return the joints at a goal and their slope, from a guess; None if the guess is not safely near."""
    joints, miss = guess, -1.0
    for _ in range(CORRECTIONS):
        linear = linear_step(tool, joints, goal, aside)
        if miss < 0.0:
            miss = _miss(tool, linear.gap)
        joints = [joint + change for joint, change in zip(joints, linear.step, strict=True)]
        # a step that is no number is not below the bound either
        if not largest_change(joints, guess, units) <= LARGEST_CORRECTION:
            return None
        moved = max(abs(change / unit) for change, unit in zip(linear.step, units, strict=True))
        if linear.closes and moved <= SETTLED_STEP:
            return _Reached(joints, linear.slope, miss)
    return None


def linear_step(tool: ToolModel, joints: Floats, goal: Goal, aside: float) -> Linear:
    """Newton's step to the goal, and the joints' slope there."""
    if tool.square and aside == 0.0:
        solved = _solve(tool, joints, goal)
        if solved is not None:
            return solved
    positions = np.array([goal.position])
    rotations = None if goal.rotation is None else np.array(goal.rotation).reshape(1, 3, 3)
    rate, place = np.array([goal.rate]), np.array([joints])
    residual, jacobian = tool.linearise(place, Targets(positions, rotations))
    step = joint_step(tool, jacobian, residual)[0]
    slope = joint_slope(tool, place, jacobian, rate, aside)[0]
    # damping near a singular position makes steps small that do not close the gap
    left = np.abs(residual[0] - jacobian[0] @ step).max()
    closes = left <= max(0.1 * np.abs(residual).max(), ROUGH_RESIDUAL) or tool.rank < tool.rows
    return Linear(residual[0].tolist(), step.tolist(), slope.tolist(), bool(closes), False)


def _solve(tool: ToolModel, joints: Floats, goal: Goal) -> Linear | None:
    """Return the exact solution, if the goal is near and the Jacobian far from singular."""
    now = tool.chain.single.linearise(joints)
    gap = [wanted - there for wanted, there in zip(goal.position, now.position, strict=True)]
    if goal.rotation is not None:
        turn = small_turn(goal.rotation, now.rotation)
        if turn is None:
            return None
        gap += turn
    solved = solve_two(now.columns, gap, goal.rate)
    if solved is None:
        return None
    step, slope = solved
    if max(_size(step), _size(slope)) > largest_gain(tool) * max(_size(gap), _size(goal.rate)):
        return None
    return Linear(gap, step, slope, True, True)


def _miss(tool: ToolModel, gap: Floats) -> float:
    off = math.hypot(*gap[:3]) / tool.tolerance
    return max(off, math.hypot(*gap[3:]) / tool.tolerance_angle) if tool.orientation else off


def largest_change(joints: Floats, others: Floats, units: Floats) -> float:
    return max(abs((a - b) / unit) for a, b, unit in zip(joints, others, units, strict=True))


def _size(values: Floats) -> float:
    return max(map(abs, values))
