"""A single pose: the joint positions nearest to where the joints are (G00 with a tool), or why none are."""

from __future__ import annotations

import numpy as np

from mckinematics import refusal
from mckinematics.errors import KinematicsError
from mckinematics.newton import newton
from mckinematics.pose import Array
from mckinematics.search import ITERATIONS, SearchResult, search, unwind, within_limits
from mckinematics.tool import RANK_THRESHOLD, Targets, ToolModel

# a solution from the joints' own place that goes no further than this is taken at once [rad]
NATURAL_TRAVEL = 1.5
# starts near the joints, between them and the seeds
NEAR_STARTS = 16
NEAR_SHARE = 0.25
# what is missing to a pose out of reach: starts, and the weight with which one part of the pose is held
MISSING_STARTS = 32
# a pose that the joints' own place leads to is found within these
NEAR_ITERATIONS = 20
# after as many, the places that go on to their end
FINALISTS = 6
HELD_WEIGHT = 100.0
# steps towards a posture, the longest change of a joint in one, and the one that is the last [rad, or m per
# metre of reach]
POSTURE_STEPS, LONGEST_SPARE_MOVE, POSTURE_TAKEN = 60, 0.3, 1e-4


def solve_target(tool: ToolModel, target: Targets, joints: Array) -> Array:
    """Joint positions, shape (K,), for one pose within the limits, nearest to ``joints``; of a chain with a
    posture as near to that as can be reached from there.

    Raises:
        JointLimit, Unreachable: as `_solve_target`.
    """
    found = _solve_target(tool, target, joints)
    return found if tool.posture is None else _take_posture(tool, target, found, tool.posture)


def _take_posture(tool: ToolModel, target: Targets, joints: Array, posture: Array) -> Array:
    """Move joints (K,) to spare towards the posture, the tool staying where it is and all within limits."""
    share = 1.0
    for _ in range(POSTURE_STEPS):
        jacobian = tool.linearise(joints[None], target)[1]
        goal = (posture - joints) / tool.unit
        scaled = jacobian[0] * tool.unit
        within = goal - np.linalg.pinv(scaled, rcond=RANK_THRESHOLD) @ (scaled @ goal)
        move = share * within * min(1.0, LONGEST_SPARE_MOVE / max(float(np.abs(within).max()), 1e-300))
        if np.abs(move).max() < POSTURE_TAKEN:
            break
        corrected, reached = newton(tool, (joints + move * tool.unit)[None], target)
        nearer = _travel(tool, corrected[0], posture) < _travel(tool, joints, posture)
        if reached[0] and nearer and within_limits(tool, corrected)[0]:
            joints, share = corrected[0], min(1.0, 2.0 * share)
        else:
            share *= 0.5
    return joints


def _solve_target(tool: ToolModel, target: Targets, joints: Array) -> Array:
    """Joint positions, shape (K,), for one pose within the limits, nearest to ``joints``.

    Raises:
        JointLimit: there are solutions, all past a limit; names the joint of the one nearest to its limits.
        Unreachable: there are none; ``residual`` is the distance that is missing [m].
    """
    own = _nearest(tool, search(tool, target, joints[None]), joints)
    if own is not None and _travel(tool, own, joints) <= NATURAL_TRAVEL:
        return own
    starts = np.concatenate(
        [joints[None], joints + NEAR_SHARE * (tool.seeds[:NEAR_STARTS] - joints), tool.seeds]
    )
    free = search(tool, target, starts)
    candidates = [found for found in (own, _nearest(tool, free, joints)) if found is not None]
    if not candidates:
        # free searches may all end outside the limits where a chain has joints to spare
        bounded = search(tool, target, starts, limited=True)
        within = _nearest(tool, bounded, joints)
        if within is None:
            raise _refusal(tool, target, free, bounded, joints)
        candidates = [within]
    return min(candidates, key=lambda found: _travel(tool, found, joints))


def missing(tool: ToolModel, target: Targets, joints: Array) -> Array:
    """What is missing to one pose at best, limits not looked at: (rows,) [m, rad]; zeros if it is reached.

    With orientation, the distance at which the tool can hold the orientation asked for; if it cannot hold
    that anywhere near, the turn that is missing while the point is held, or both.
    """
    if search(tool, target, joints[None], iterations=NEAR_ITERATIONS).reached.any():
        return np.zeros(tool.rows)
    starts = np.concatenate([joints[None], tool.seeds[:MISSING_STARTS]])
    found = _best(tool, target, starts)
    if found.reached.any():
        return np.zeros(tool.rows)
    least = _least(found)
    if not tool.orientation:
        return least
    held = _least(_best(tool, target, starts, turn_weight=HELD_WEIGHT), turn_weight=HELD_WEIGHT)
    # with this weight a turn that can be held is off by 1e-4 of the distance at most
    distance, turn = np.linalg.norm(held[:3]), np.linalg.norm(held[3:])
    if turn <= 100.0 / HELD_WEIGHT**2 * distance / tool.chain.reach + tool.residual_tolerance_angle:
        return np.concatenate([held[:3], np.zeros(3)])
    point = _least(_best(tool, target, starts, point_weight=HELD_WEIGHT), point_weight=HELD_WEIGHT)
    if np.linalg.norm(point[:3]) < tool.tolerance:
        return np.concatenate([np.zeros(3), point[3:]])
    return point


def missing_within_limits(tool: ToolModel, target: Targets, joints: Array) -> float:
    """Distance that is missing to one pose at best, with the joints within their limits [m]."""
    starts = np.concatenate([joints[None], tool.seeds[:MISSING_STARTS]])
    return float(np.linalg.norm(_least(_best(tool, target, starts, limited=True))[:3]))


def _best(
    tool: ToolModel,
    target: Targets,
    starts: Array,
    *,
    limited: bool = False,
    point_weight: float = 1.0,
    turn_weight: float = 1.0,
) -> SearchResult:
    """As `search`, but only those that have come nearest after some iterations go on to their end."""

    def go_on(places: Array, iterations: int) -> SearchResult:
        return search(
            tool,
            target,
            places,
            limited=limited,
            point_weight=point_weight,
            turn_weight=turn_weight,
            iterations=iterations,
        )

    found = go_on(starts, NEAR_ITERATIONS)
    if found.reached.any():
        return found
    order = np.argsort(_costs(found, point_weight, turn_weight), kind="stable")
    return go_on(found.joints[order[:FINALISTS]], ITERATIONS)


def _costs(found: SearchResult, point_weight: float, turn_weight: float) -> Array:
    point = np.linalg.norm(found.residuals[:, :3], axis=1)
    turn = np.linalg.norm(found.residuals[:, 3:], axis=1)
    return np.asarray(np.hypot(point_weight * point, turn_weight * turn), dtype=np.float64)


def _least(found: SearchResult, *, point_weight: float = 1.0, turn_weight: float = 1.0) -> Array:
    least: Array = found.residuals[int(np.argmin(_costs(found, point_weight, turn_weight)))]
    return least


def _travel(tool: ToolModel, joints: Array, start: Array) -> float:
    return float(np.linalg.norm((joints - start) / tool.unit))


def _nearest(tool: ToolModel, found: SearchResult, joints: Array) -> Array | None:
    if not found.reached.any():
        return None
    solutions = unwind(tool, found.joints[found.reached], joints)
    solutions = solutions[within_limits(tool, solutions)]
    if not len(solutions):
        return None
    nearest: Array = min(solutions, key=lambda solution: _travel(tool, solution, joints))
    return nearest


def _refusal(
    tool: ToolModel, target: Targets, free: SearchResult, bounded: SearchResult, joints: Array
) -> KinematicsError:
    place = target.positions[0]
    if not free.reached.any():
        return refusal.unreachable(tool, missing(tool, target, joints), place, None)
    chain = tool.chain
    unit = tool.unit
    solutions = unwind(tool, free.joints[free.reached], joints)
    excess = np.maximum(chain.lower - solutions, solutions - chain.upper) / unit
    least = int(np.argmin(excess.max(axis=1)))
    column = int(np.argmax(excess[least]))
    left = float(np.linalg.norm(_least(bounded)[:3]))
    return refusal.joint_limit(tool, column, float(solutions[least, column]), place, None, left)
