"""Measure the time of inverse kinematics for each line of a program."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from mckinematics.even_path import EvenPaths
from mckinematics.pose import Array, JointPath, Kinematics, Pose, ToolPath


class TimedKinematics:
    """`mckinematics.pose.Kinematics` that measures the time of its solutions, refused ones included.

    Args:
        kinematics: to measure.
        clock: [s], only differences matter.
    """

    def __init__(self, kinematics: Kinematics, clock: Callable[[], float]) -> None:
        self._kinematics = kinematics
        self._clock = clock
        self._spent = 0.0

    def take(self) -> float:
        """Time spent on solutions since the last call [s]."""
        spent, self._spent = self._spent, 0.0
        return spent

    def __getattr__(self, name: str) -> Any:
        """Forward everything but solving, which takes too little time to measure."""
        return getattr(self._kinematics, name)

    def solve_pose(self, tool: int, pose: Pose, joints: Mapping[int, float]) -> tuple[float, ...]:
        """Joint positions for a pose; raises `KinematicsError`."""
        with self._measured():
            return self._kinematics.solve_pose(tool, pose, joints)

    def solve_path(self, tool: int, path: ToolPath, joints: Mapping[int, float]) -> JointPath:
        """Joint path along a tool's path; raises `KinematicsError`."""
        with self._measured():
            return self._kinematics.solve_path(tool, path, joints)

    def solve_even_paths(
        self, tool: int, points: Array, angles: Array | None, joints: Mapping[int, float]
    ) -> EvenPaths:
        """Joints going evenly along consecutive lines of a tool."""
        with self._measured():
            return self._kinematics.solve_even_paths(tool, points, angles, joints)

    @contextmanager
    def _measured(self) -> Iterator[None]:
        began = self._clock()
        try:
            yield
        finally:
            self._spent += self._clock() - began
