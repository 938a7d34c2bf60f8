"""Trajectories of joints: what is one, and where the joints are on it at a time.

Between points with velocities the way is a cubic, with accelerations too a quintic, as
joint_trajectory_controller has it. Points with positions alone are joined by monotone cubics (Fritsch and
Carlson) that rest at both ends, where that controller goes straight with steps of velocity, which no axis can
follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly, CubicHermiteSpline, PchipInterpolator

from mcserver.ros.joints import Joint
from mcserver.ros.outcome import INVALID_GOAL, INVALID_JOINTS, InvalidGoal
from mcserver.ros.stamps import seconds_of

Array = NDArray[np.float64]

MAX_POINTS = 10_000
LONGEST_S = 3600.0
# How far off a trajectory whose first point is now may begin [m], [rad].
START_LINEAR, START_ROTARY = 1e-3, 0.02
# A curve may be quicker than its axis by this share: planners go to the limit at points, and cubics swing.
OVERSPEED = 0.05
# looked at between two points
LOOKS = 8
# points of the way onto a trajectory: where the joints are, and two of its own
ONTO = 3


@dataclass(frozen=True)
class Trajectory:
    """Points of joints in ascending times.

    Attributes:
        joints: in the order of the columns. times: shape (m,) [s].
        positions, velocities, accelerations: shape (m, n) [m or rad, per s]; the last two may be None.
    """

    joints: tuple[Joint, ...]
    times: Array
    positions: Array
    velocities: Array | None
    accelerations: Array | None

    @property
    def duration_s(self) -> float:
        return float(self.times[-1])

    @property
    def axes(self) -> tuple[int, ...]:
        return tuple(joint.axis for joint in self.joints)


def read_trajectory(message: Any, known: Mapping[str, Joint]) -> Trajectory:
    """Read a ``trajectory_msgs/msg/JointTrajectory``.

    Raises:
        InvalidGoal: what is wrong with it, with the code of the action's result.
    """
    names = message.joint_names
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InvalidGoal(INVALID_JOINTS, f"there is no joint {unknown[0]!r}; there are {', '.join(known)}")
    if not names or len(set(names)) != len(names):
        raise InvalidGoal(INVALID_JOINTS, "each joint is named once, and one at least")
    points = message.points
    if not points or len(points) > MAX_POINTS:
        raise InvalidGoal(INVALID_GOAL, f"{len(points)} points; 1 to {MAX_POINTS} are possible")
    times = np.array([seconds_of(point.time_from_start) for point in points])
    if times[0] < 0.0 or (np.diff(times) <= 0.0).any():
        raise InvalidGoal(INVALID_GOAL, "the times of the points do not increase")
    if times[-1] > LONGEST_S:
        raise InvalidGoal(INVALID_GOAL, f"it takes {times[-1]:g} s; {LONGEST_S:g} s at most are possible")
    positions = _column(points, "positions", len(names))
    if positions is None:
        raise InvalidGoal(INVALID_GOAL, "the points have no positions")
    velocities = _column(points, "velocities", len(names))
    accelerations = _column(points, "accelerations", len(names)) if velocities is not None else None
    if velocities is not None and velocities[-1].any():
        raise InvalidGoal(INVALID_GOAL, "the last point has a velocity: the joints come to rest there")
    trajectory = Trajectory(tuple(known[name] for name in names), times, positions, velocities, accelerations)
    _check_travel(trajectory.joints, times, positions)
    if len(times) > 1:
        first = np.zeros(len(names)) if velocities is None else velocities[0]
        Motion(trajectory, float(times[0]), positions[0], first)
    return trajectory


def _column(points: Sequence[Any], name: str, count: int) -> Array | None:
    """Return a field of all points, shape (m, n); None: no point has it."""
    rows = [getattr(point, name) for point in points]
    if not any(len(row) for row in rows):
        return None
    if any(len(row) != count for row in rows):
        raise InvalidGoal(INVALID_GOAL, f"{name} have to be of all {count} joints, in all points or in none")
    values = np.array(rows, np.float64)
    if not np.isfinite(values).all():
        raise InvalidGoal(INVALID_GOAL, f"{name} are not all finite")
    return values


def _check_travel(joints: Sequence[Joint], times: Array, positions: Array) -> None:
    for column, joint in enumerate(joints):
        beyond = np.maximum(joint.low - positions[:, column], positions[:, column] - joint.high)
        # an axis that stands at the end of its travel reads a little more or less
        outside = beyond > joint.in_position + 1e-9
        if outside.any():
            at = int(np.argmax(outside))
            raise InvalidGoal(
                INVALID_GOAL,
                f"{joint.name} would be at {positions[at, column]:.6g} after {times[at]:g} s; "
                f"its travel is {joint.low:.6g} to {joint.high:.6g}",
            )


class Motion:
    """A trajectory as it is followed, from where the joints are.

    Args:
        begin_s: time on the trajectory at which the joints leave where they are; below 0: it begins later.
        position, velocity: of the joints then, shape (n,).
        looked_at: by `read_trajectory`: only the way onto the trajectory is looked at here, which is quick
            even where there are 10 000 points.

    Raises:
        InvalidGoal: it begins elsewhere, or asks for more speed or travel than a joint has.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        begin_s: float,
        position: Array,
        velocity: Array,
        *,
        looked_at: bool = False,
    ) -> None:
        self.trajectory = trajectory
        self.begin_s = begin_s
        self.end_s = trajectory.duration_s
        ahead = trajectory.times > begin_s
        if not ahead[0]:
            self._refuse_elsewhere(position)
        if not ahead.any():
            # the last point is now: where the joints are is where they are to be
            ahead[-1] = True
            begin_s = self.begin_s = self.end_s - 1e-3
        self.times = np.concatenate(([begin_s], trajectory.times[ahead]))
        positions = np.vstack((position, trajectory.positions[ahead]))
        self._final = positions[-1]
        if trajectory.velocities is None:
            # of points that are almost the same the slopes are divided by nearly nothing, and become 0
            with np.errstate(all="ignore"):
                slopes = PchipInterpolator(self.times, positions, axis=0).derivative()(self.times)
            slopes[0], slopes[-1] = velocity, 0.0
            self._curve = CubicHermiteSpline(self.times, positions, slopes, axis=0)
        else:
            velocities = np.vstack((velocity, trajectory.velocities[ahead]))
            if trajectory.accelerations is None:
                self._curve = CubicHermiteSpline(self.times, positions, velocities, axis=0)
            else:
                start = np.zeros((1, positions.shape[1]))
                accelerations = np.vstack((start, trajectory.accelerations[ahead]))
                stacked = np.stack((positions, velocities, accelerations), axis=1)
                self._curve = BPoly.from_derivatives(self.times, stacked)
        self._slope = self._curve.derivative()
        self._check_between(ONTO if looked_at else len(self.times))

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return positions and velocities at times of the trajectory, (k, n) each; at rest outside of it."""
        inside = (times > self.begin_s) & (times < self.end_s)
        clipped = np.clip(times, self.begin_s, self.end_s)
        positions, velocities = self._curve(clipped), self._slope(clipped) * inside[:, None]
        positions[times >= self.end_s] = self._final
        return positions, velocities

    def bounds(self) -> tuple[Array, Array]:
        """Return the least and the greatest positions from where the joints are to the end, shape (n,) each.

        The way is looked at as often as it is for its speed: between two looks it may go beyond by a little.
        """
        positions = np.vstack((self.at(self._looks(self.times))[0], self._final))
        return positions.min(axis=0), positions.max(axis=0)

    def _looks(self, times: Array) -> Array:
        """Return times from each of some points to the next, without the last one."""
        looks: Array = (times[:-1, None] + np.diff(times)[:, None] * (np.arange(LOOKS) / LOOKS)).ravel()
        return looks

    def _refuse_elsewhere(self, position: Array) -> None:
        trajectory = self.trajectory
        begin_s = min(self.begin_s, self.end_s)
        for column, joint in enumerate(trajectory.joints):
            there = float(np.interp(begin_s, trajectory.times, trajectory.positions[:, column]))
            if abs(there - position[column]) > (START_ROTARY if joint.rotary else START_LINEAR):
                raise InvalidGoal(
                    INVALID_GOAL,
                    f"it begins at once with {joint.name} at {there:.6g}, not at {position[column]:.6g}: "
                    "give the first point time to get there",
                )

    def _check_between(self, count: int) -> None:
        """Refuse what is wrong with the first ``count`` points and the ways between them."""
        looks = self._looks(self.times[:count])
        positions, velocities = self.at(looks)
        if not (np.isfinite(positions).all() and np.isfinite(velocities).all()):
            raise InvalidGoal(INVALID_GOAL, "its points are too close in time for the way between them")
        for column, joint in enumerate(self.trajectory.joints):
            quickest = int(np.argmax(np.abs(velocities[:, column])))
            speed = abs(velocities[quickest, column])
            if speed > (1.0 + OVERSPEED) * joint.max_velocity:
                raise InvalidGoal(
                    INVALID_GOAL,
                    f"{joint.name} would go at {speed:.6g} after {max(looks[quickest], 0.0):.3g} s; "
                    f"it can go at {joint.max_velocity:.6g}",
                )
        _check_travel(self.trajectory.joints, looks, positions)
