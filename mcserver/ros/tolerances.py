"""Tolerances of a goal: how far joints may be off on the way, and at its end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.ros.joints import Joint
from mcserver.ros.outcome import INVALID_GOAL, INVALID_JOINTS, InvalidGoal
from mcserver.ros.stamps import seconds_of

Array = NDArray[np.float64]

# How long the joints may take to settle at the end where a goal does not say [s].
SETTLE_S = 5.0


@dataclass(frozen=True)
class Tolerances:
    """Bounds by joint, infinite where there is none; shape (n,) each [m or rad, per s].

    Attributes:
        settle_s: behind the trajectory's end [s].
    """

    path: Array
    path_velocity: Array
    goal: Array
    goal_velocity: Array
    settle_s: float = SETTLE_S

    def violated_on_path(self, error: Array, velocity_error: Array) -> int | None:
        """Return the column of the first joint that is too far off; None: none is."""
        return _first((np.abs(error) > self.path) | (np.abs(velocity_error) > self.path_velocity))

    def violated_at_goal(self, error: Array, velocity: Array) -> int | None:
        """Return the column of the first joint that has not arrived; None: all have."""
        return _first((np.abs(error) > self.goal) | (np.abs(velocity) > self.goal_velocity))


def read_tolerances(goal: Any, joints: Sequence[Joint]) -> Tolerances:
    """Return a goal's tolerances: a positive one counts, 0 is the default, a negative one is none.

    By default the path has none, as with joint_trajectory_controller, and the end that of the machine file's
    `in_position`. Accelerations are not measured, and not looked at.

    Raises:
        InvalidGoal: of a joint that the goal does not move, not finite, or of several degrees of freedom.
    """
    if goal.component_path_tolerance or goal.component_goal_tolerance or goal.multi_dof_trajectory.points:
        raise InvalidGoal(INVALID_GOAL, "joints with several degrees of freedom are not known here")
    count = len(joints)
    nothing = np.full(count, math.inf)
    arrived = np.array([joint.in_position or math.inf for joint in joints])
    path, path_velocity = _read(goal.path_tolerance, joints, nothing)
    end, end_velocity = _read(goal.goal_tolerance, joints, arrived)
    settle_s = seconds_of(goal.goal_time_tolerance)
    return Tolerances(path, path_velocity, end, end_velocity, settle_s if settle_s > 0.0 else SETTLE_S)


def _read(given: Sequence[Any], joints: Sequence[Joint], default: Array) -> tuple[Array, Array]:
    positions, velocities = default.copy(), np.full(len(joints), math.inf)
    columns = {joint.name: column for column, joint in enumerate(joints)}
    for each in given:
        column = columns.get(each.name)
        if column is None:
            raise InvalidGoal(
                INVALID_JOINTS, f"a tolerance of {each.name!r}, which the trajectory does not move"
            )
        if not (math.isfinite(each.position) and math.isfinite(each.velocity)):
            raise InvalidGoal(INVALID_GOAL, f"the tolerance of {each.name} is not finite")
        if each.position:
            positions[column] = each.position if each.position > 0.0 else math.inf
        if each.velocity > 0.0:
            velocities[column] = each.velocity
    return positions, velocities


def _first(violated: NDArray[np.bool_]) -> int | None:
    return int(np.argmax(violated)) if violated.any() else None
