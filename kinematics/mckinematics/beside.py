"""A tool beside where its joints have it, shifted along a line: on a conveyor that goes on, say.

Its orientation, where it has one, stays. The joints that hold it there go on from those before, so that the
chain never changes over to another configuration.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mckinematics import refusal
from mckinematics.errors import KinematicsError
from mckinematics.next_pose import solve_goal
from mckinematics.pose import Array
from mckinematics.pose_solver import missing
from mckinematics.single import Floats
from mckinematics.tool import Targets, ToolModel
from mckinematics.trace import Goal

# Share of the reach between places that are looked at.
STEP = 0.05
# Smallest singular value at which the tool still goes everywhere (`ToolModel.conditioning`).
LEAST_CONDITIONING = 0.02
# A converted unit may miss its limit in the last bits [rad or m].
ROUNDING = 1e-9


class Miss(NamedTuple):
    """Where the joints cannot hold a tool.

    Attributes:
        way: by which it is shifted there [m]. goal: its pose. column, value: of a joint beyond its limit, and
            where it would be; column -1: of none. conditioning: there; NaN: it is not reached.
    """

    way: float
    goal: Goal
    column: int = -1
    value: float = math.nan
    conditioning: float = math.nan


def goal_beside(
    tool: ToolModel, joints: Floats, rates: Floats, direction: Floats, way: float, speed: float
) -> Goal:
    """Return the pose at joints [rad or m] with their rates, shifted by a way [m] that grows at a speed."""
    here = tool.chain.single.linearise(joints)
    rate = [
        math.fsum(column[row] * each for column, each in zip(here.columns, rates, strict=True))
        for row in range(tool.rows)
    ]
    for row in range(3):
        rate[row] += speed * direction[row]
    position = [place + way * each for place, each in zip(here.position, direction, strict=True)]
    return Goal(position, here.rotation if tool.orientation else None, rate)


def places_beside(
    tool: ToolModel, joints: Floats, direction: Floats, window: tuple[float, float]
) -> Iterator[Floats | Miss]:
    """Shift a tool from ``joints`` on, to both ends of a window with 0 in it [m].

    Args:
        direction: a unit vector in the frame of the tool's poses.

    Yields:
        At one place after the other the joints' rates by the way; at the first where they cannot hold the
        tool, the last one, what is in the way.
    """
    still = [0.0] * len(joints)
    begun = _place(tool, joints, goal_beside(tool, joints, still, direction, 0.0, 1.0), 0.0)
    yield begun if isinstance(begun, Miss) else begun[1]
    if isinstance(begun, Miss):
        return
    for end in window:
        places, slope = begun
        steps = math.ceil(abs(end) / (STEP * tool.chain.reach))
        for number in range(1, steps + 1):
            way = end * number / steps
            goal = goal_beside(tool, joints, still, direction, way, 1.0)
            guess = [place + rate * end / steps for place, rate in zip(places, slope, strict=True)]
            found = _place(tool, guess, goal, way)
            if isinstance(found, Miss):
                yield found
                return
            places, slope = found
            yield slope


def _place(tool: ToolModel, guess: Floats, goal: Goal, way: float) -> tuple[list[float], list[float]] | Miss:
    """Return the joints at a goal and their rates, or what is in the way."""
    found = solve_goal(tool, guess, goal)
    if found is None:
        return Miss(way, goal)
    chain = tool.chain
    for column, value in enumerate(found[0]):
        if not chain.lower[column] - ROUNDING <= value <= chain.upper[column] + ROUNDING:
            return Miss(way, goal, column, value)
    columns = np.array(chain.single.linearise(found[0]).columns).T[None, : tool.rows]
    conditioning = float(tool.conditioning(columns)[0])
    return found if conditioning >= LEAST_CONDITIONING else Miss(way, goal, conditioning=conditioning)


def check_beside(
    tool: ToolModel, path: Array, shares: Array, direction: Floats, window: tuple[float, float]
) -> None:
    """Refuse a path that a tool cannot be shifted beside, at joints (n, K) and their shares of the path (n,).

    Raises:
        JointLimit, Unreachable, Singular, BranchJump: at the first of the places looked at.
    """
    for joints, share in zip(path.tolist(), shares.tolist(), strict=True):
        for found in places_beside(tool, joints, direction, window):
            if isinstance(found, Miss):
                raise _refusal(tool, np.array(joints), found, share)


def _refusal(tool: ToolModel, joints: Array, miss: Miss, share: float) -> KinematicsError:
    place = np.array(miss.goal.position)
    if miss.column >= 0:
        found: KinematicsError = refusal.joint_limit(tool, miss.column, miss.value, place, share, None)
    elif not math.isnan(miss.conditioning):
        found = refusal.singular(tool, miss.conditioning, place, share)
    else:
        turned = None if miss.goal.rotation is None else np.array(miss.goal.rotation).reshape(1, 3, 3)
        left = missing(tool, Targets(place[None], turned), joints)
        near = not np.abs(left).max() > 0.0
        found = (
            refusal.branch_jump(tool, place, share) if near else refusal.unreachable(tool, left, place, share)
        )
    found.message += f", taken along by {1e3 * miss.way:.4g} mm by what it follows"
    found.hint = "work further from there, or give its follow a narrower window"
    return found
