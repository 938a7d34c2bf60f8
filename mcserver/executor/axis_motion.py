"""Independent motion of one axis on a trajectory, with the axes that follow it on a line."""

from __future__ import annotations

import enum
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from ruckig import Trajectory

from mcserver.executor.trajectories import MotionLimits, State
from mcserver.motion.canonical import SurfaceSpeed

Array = NDArray[np.float64]
Followers = Mapping[int, tuple[float, float]]


class MotionKind(enum.Enum):
    """What ends an independent motion."""

    POSITION = enum.auto()  # at its target
    SPEED = enum.auto()  # never: the speed is held
    HALT = enum.auto()  # at standstill
    FOLLOW = enum.auto()  # its owner, which sets its state cycle by cycle


class Motion:
    """Independent motion of one axis.

    Attributes:
        slot: whose rate applies, -1: the machine's. elapsed: time on the trajectory [s].
        origin: position at which the trajectory starts. final: position and velocity at its end.
        limits: that it keeps. followers: other columns on the line, column → (position, share): a follower is
            at position + share · (own position - anchor). lost: its own column no longer moves with it.
        surface: axis and constant surface speed that set its velocity in each cycle (D-120); None: fixed.
        target: of a position motion. rate: share of the axis's speed that it is planned with; 0: it is held.
    """

    __slots__ = (
        "anchor",
        "column",
        "duration",
        "elapsed",
        "final",
        "followers",
        "kind",
        "limits",
        "lost",
        "origin",
        "rate",
        "slot",
        "surface",
        "target",
        "trajectory",
    )

    def __init__(
        self,
        column: int,
        slot: int,
        kind: MotionKind,
        trajectory: Trajectory,
        origin: float,
        final: tuple[float, float],
        limits: MotionLimits,
    ) -> None:
        self.column = column
        self.slot = slot
        self.kind = kind
        self.trajectory = trajectory
        self.duration: float = trajectory.duration
        self.elapsed = 0.0
        self.origin = origin
        self.final = final
        self.limits = limits
        self.followers: Followers = {}
        self.anchor = origin
        self.lost = False
        self.surface: tuple[int, SurfaceSpeed] | None = None
        self.target = final[0]
        self.rate = 1.0

    @property
    def columns(self) -> int:
        """Mask of the columns that it moves."""
        mask = 0 if self.lost else 1 << self.column
        for column in self.followers:
            mask |= 1 << column
        return mask

    def place_of(self, column: int, place: float) -> float:
        """Return the position of a column, its own or a follower, with its own at ``place`` [m or rad]."""
        if column == self.column:
            return place
        start, share = self.followers[column]
        return start + share * (place - self.anchor)

    def extremes(self) -> tuple[float, float]:
        """Return the least and greatest position of its own column from now to its end [m or rad]."""
        bounds = self.trajectory.position_extrema[0]
        return self.origin + bounds.min, self.origin + bounds.max

    def follow(self, other: Motion) -> None:
        """Take over the followers of the motion that this one supersedes."""
        self.followers, self.anchor, self.lost = other.followers, other.anchor, other.lost

    @property
    def held(self) -> bool:
        """Whether it is a position motion that stands in feed hold."""
        return self.kind is MotionKind.POSITION and self.rate <= 0.0 and self.elapsed >= self.duration

    def at(self, elapsed: float) -> State:
        """Position, velocity and acceleration on the trajectory."""
        if elapsed >= self.duration:
            position, velocity = self.final
            return position + velocity * (elapsed - self.duration), velocity, 0.0
        position, velocity, acceleration = self.trajectory.at_time(max(elapsed, 0.0))
        return self.origin + position[0], velocity[0], acceleration[0]

    def along(self, elapsed: Array) -> tuple[Array, Array]:
        """Positions and velocities that `at` returns at ascending times, shape (n,) each."""
        inside = int(np.searchsorted(elapsed, self.duration))
        states = np.array([self.at(each) for each in elapsed[:inside].tolist()]).reshape(inside, 3)
        place, speed = self.final
        behind = place + speed * (elapsed[inside:] - self.duration)
        return (
            np.concatenate((states[:, 0], behind)),
            np.concatenate((states[:, 1], np.full(len(behind), speed))),
        )


class FollowingMotion(Motion):
    """An axis that follows streamed targets: its state is set from outside in every cycle.

    Args:
        state: shape (3,), position, velocity and acceleration after the latest cycle; not copied.
    """

    __slots__ = ("_state",)

    def __init__(self, column: int, slot: int, limits: MotionLimits, state: Array) -> None:
        super().__init__(column, slot, MotionKind.FOLLOW, Trajectory(1), 0.0, (0.0, 0.0), limits)
        self._state = state

    @property
    def stands(self) -> bool:
        """Whether it is at rest."""
        return bool(self._state[1] == 0.0 and self._state[2] == 0.0)

    def at(self, elapsed: float) -> State:  # noqa: ARG002
        """Return the state after the latest cycle, the only one there is."""
        position, velocity, acceleration = self._state.tolist()
        return position, velocity, acceleration
