"""Measure the time of inverse kinematics for each line of a program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mckinematics.pose import Kinematics

# Methods that are measured; the others take too little time.
SOLVING = frozenset(("solve_pose", "solve_path", "solve_even_path"))


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
        found = getattr(self._kinematics, name)
        if name not in SOLVING:
            return found

        def measured(*arguments: Any) -> Any:
            began = self._clock()
            try:
                return found(*arguments)
            finally:
                self._spent += self._clock() - began

        return measured
