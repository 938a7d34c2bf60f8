"""A first task: the tool's point, or the axes, are to reach a place and rest there."""

from __future__ import annotations

from typing import Any

import numpy as np

from mcclient_gym.servo import Actions, Array, ServoEnv

# How far from the start an axis may be at the goal [m or rad], and how near counts as reached [m or rad].
AROUND, REACHED = 0.5, 0.005


class ReachEnv(ServoEnv):
    """Where the axes are to go is drawn for each episode, about the start; the reward is how much nearer.

    With a tool the goal is its point [m], else the axes' positions; it is the end of each observation.
    """

    def __init__(
        self,
        machine: str = "arm6",
        *,
        actions: Actions = "twist",
        tool: int | None = 1,
        period_s: float = 0.02,
    ) -> None:
        super().__init__(machine, actions=actions, tool=tool, period_s=period_s)
        self.goal = self._place(self.start)
        self._before = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        drawn = self.start + self.np_random.uniform(-AROUND, AROUND, len(self.start))
        self.goal = self._place(np.clip(drawn, self._low, self._high))
        self._before = self._left()
        return self.observe(), self._info()

    def observe(self) -> Array:
        return np.concatenate((super().observe(), self.goal))

    def most_observed(self) -> Array:
        most = super().most_observed()
        goal = most[: len(self.start)] if self._tool is None else np.full(3, self.tip_reach)
        return np.concatenate((most, goal))

    def judge(self) -> tuple[float, bool]:
        left = self._left()
        nearer, self._before = self._before - left, left
        resting = bool(np.abs(self.velocities).max() < REACHED)
        return nearer, left < REACHED and resting

    def _left(self) -> float:
        here = self.positions if self._tool is None else self.point
        return float(np.linalg.norm(self.goal - here))

    def _place(self, positions: Array) -> Array:
        return positions.copy() if self._tool is None else self.tip(positions)
