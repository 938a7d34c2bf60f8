"""Lead axes over streamed targets cycle by cycle, without drives: for the executor and Gym environments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mcserver.executor.entries import Array
from mcserver.executor.shm.target_box import POINTS, Targets
from mcserver.machine.axis import Axis
from mcserver.motion.kernels.target_tracking import (
    ACCELERATION,
    POSITION,
    VELOCITY,
    follow_reference,
)

# Points less than this ahead of now count as passed [cycles].
AHEAD = 0.5
# If all are, the last one is moved this far ahead [cycles].
NEXT = 2.0


class TargetFollower:
    """Lets n axes follow the newest targets within their limits.

    Args:
        axes: n axes. places: their positions, at rest, shape (n,) [m or rad]. at: executor time [s].
        cycle_s: duration of a cycle [s]. unlimited: axes without travel limits now; None: as configured.

    Attributes:
        states: shape (n, 3), position, velocity and acceleration of the newest setpoint.
        newest: the targets that are followed; None before the first.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        places: Array,
        *,
        at: float,
        cycle_s: float,
        unlimited: Sequence[bool] | None = None,
    ) -> None:
        count = len(axes)
        self.states = np.zeros((count, 3))
        self.states[:, POSITION] = places
        self.newest: Targets | None = None
        free = [False] * count if unlimited is None else unlimited
        self._limits = np.array(
            [
                tracking_limits(axis, float(place), free=each)
                for axis, place, each in zip(axes, places, free, strict=True)
            ]
        ).reshape(count, 5)
        self._cycle_s = cycle_s
        self._reference = self.states.copy()
        self._room = np.zeros((POINTS + 1, 1 + 2 * count))
        # part of the buffer in use: the knots from the reference on
        self._knots = self._room[:0]
        # time at which the reference was last read
        self._at = at

    def take(self, newest: Targets) -> None:
        """Lead the reference from its present state over the points ahead; ignore non-finite targets."""
        if not np.isfinite(newest.knots).all():
            return
        self.newest = newest
        at, knots = self._at, newest.knots
        ahead = knots[knots[:, 0] > at + AHEAD * self._cycle_s]
        if not len(ahead):
            ahead = knots[-1:].copy()
            axes = len(self.states)
            passed = at + NEXT * self._cycle_s - ahead[0, 0]
            with np.errstate(over="ignore"):
                # a state that overflows stops the axes
                ahead[0, 0] += passed
                ahead[0, 1 : 1 + axes] += passed * ahead[0, 1 + axes :]
        self._knots = self._room[: 1 + len(ahead)]
        self._knots[0, 0] = at
        self._knots[0, 1:] = self._reference[:, :ACCELERATION].T.ravel()
        self._knots[1:] = ahead

    def step(self, times: Array, rate: float) -> None:
        """Advance by cycles at a share of the axes' top speed, 0: to a stop; ``times``: at their ends [s]."""
        by_velocity = self.newest is not None and self.newest.by_velocity
        follow_reference(
            self.states, self._reference, self._knots, self._limits, rate, times, self._cycle_s, by_velocity
        )
        self._at = float(times[-1])

    @property
    def stands(self) -> bool:
        """Whether all axes are at rest."""
        return not self.states[:, VELOCITY:].any()

    @property
    def arrived(self) -> bool:
        """Whether the axes have reached the last targets."""
        behind = self._at >= self._knots[-1, 0]
        return bool(behind and (self.states == self._reference).all())

    @property
    def rests(self) -> bool:
        """Whether the newest targets end at rest."""
        newest, first = self.newest, 1 + len(self.states)
        return newest is not None and not newest.by_velocity and not newest.knots[-1, first:].any()


class Bounds(NamedTuple):
    """Bounds of position and speed besides an axis's own limits [m or rad, per s]."""

    low: float = -np.inf
    high: float = np.inf
    speed: float = np.inf

    def within(self, other: Bounds) -> Bounds:
        """Return the intersection with other bounds."""
        return Bounds(max(self.low, other.low), min(self.high, other.high), min(self.speed, other.speed))

    def shifted(self, distance: float) -> Bounds:
        """Return the bounds with positions shifted by ``distance``."""
        return Bounds(self.low + distance, self.high + distance, self.speed)


UNBOUNDED = Bounds()


def tracking_limits(axis: Axis, place: float, *, free: bool, within: Bounds = UNBOUNDED) -> tuple[float, ...]:
    """Return a row of ``limits`` of `follow_targets` for an axis at a position [m or rad].

    Args:
        free: its travel limits do not apply. within: further bounds.
    """
    low, high = (-np.inf, np.inf) if free else (axis.min_position, axis.max_position)
    low, high, speed = max(low, within.low), min(high, within.high), min(axis.max_velocity, within.speed)
    # an axis outside its travel may come back, but move no further out
    return speed, axis.max_acceleration, axis.max_jerk, min(low, place), max(high, place)
