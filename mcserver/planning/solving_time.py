"""How long inverse kinematics takes for each line of a program."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mckinematics.dynamics import JointDynamics
from mckinematics.pose import Array, JointPath, Kinematics, Pose, ToolPath, Triple
from mckinematics.tip_control import TipControl


class TimedKinematics:
    """`mckinematics.pose.Kinematics` that measures the time of its solutions, refused ones included.

    Args:
        kinematics: what solves.
        clock: [s], only differences count.
    """

    def __init__(self, kinematics: Kinematics, clock: Callable[[], float]) -> None:
        self._kinematics = kinematics
        self._clock = clock
        self._spent = 0.0

    def take(self) -> float:
        """Time spent on solutions since the last call [s]."""
        spent, self._spent = self._spent, 0.0
        return spent

    @property
    def tools(self) -> tuple[int, ...]:
        """Numbers of the configured tools, sorted."""
        return self._kinematics.tools

    @property
    def dynamics(self) -> JointDynamics | None:
        """Torques of the tools' joints."""
        return self._kinematics.dynamics

    def axes(self, tool: int) -> tuple[int, ...]:
        """Axis numbers of the tool's chain, in order."""
        return self._kinematics.axes(tool)

    def has_orientation(self, tool: int) -> bool:
        """Whether A B C are allowed."""
        return self._kinematics.has_orientation(tool)

    def pose(self, tool: int, joints: Mapping[int, float]) -> Pose:
        """Forward kinematics."""
        return self._kinematics.pose(tool, joints)

    def rotation_angle(self, tool: int, start: Triple, end: Triple) -> float:
        """Angle of the single turn between two orientations [rad]."""
        return self._kinematics.rotation_angle(tool, start, end)

    def jacobians(self, tool: int, joints: Array) -> Array:
        """Rates of the tool by those of its joints at n places of these, shape (n, 3 or 6, K)."""
        return self._kinematics.jacobians(tool, joints)

    def solve_pose(self, tool: int, pose: Pose, joints: Mapping[int, float]) -> tuple[float, ...]:
        """Joint positions for a pose; raises `KinematicsError`."""
        began = self._clock()
        try:
            return self._kinematics.solve_pose(tool, pose, joints)
        finally:
            self._spent += self._clock() - began

    def tip_control(self, tool: int, length: float) -> TipControl:
        """The tool with a cutter of a length [m], led by its tip; not measured."""
        return self._kinematics.tip_control(tool, length)

    def solve_path(self, tool: int, path: ToolPath, joints: Mapping[int, float]) -> JointPath:
        """Joint path along a tool's path; raises `KinematicsError`."""
        began = self._clock()
        try:
            return self._kinematics.solve_path(tool, path, joints)
        finally:
            self._spent += self._clock() - began
