"""Axes that follow streamed targets: the barrier at which a program of servo mode waits.

Targets may be late, wrong or missing. For any targets `TargetFollower` keeps velocity, acceleration, jerk and
travel, and by a share of these the torques (`mcserver.motion.limits.torque_in_box`). A silence longer than
the newest message is valid ends the program by a stop within these limits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from mcserver.executor.barriers import Barrier
from mcserver.executor.cycle import Cycle
from mcserver.executor.shm.target_box import TargetBox
from mcserver.executor.target_follower import Bounds, TargetFollower
from mcserver.executor.trajectories import MotionLimits
from mcserver.machine.axis import Axis
from mcserver.motion.kernels.target_tracking import POSITION, VELOCITY
from mcserver.motion.limits.torque_in_box import followed_axis


class Follows(Barrier):
    """The barrier at which u stands while axes follow targets.

    Args:
        axes: mask of columns, all energized and at rest. slot: their program's. box: the targets.
        rate: the slot's share of speed, 0 in feed hold.
        bounds: of each axis, besides its travel and speed; an axis that is outside may come back.
        share: as in `followed_axis`.
        lost: called once when no targets have come in time, with the seconds since the newest ones and the
            seconds for which these were valid; it stops the axes.
    """

    def __init__(
        self,
        cycle: Cycle,
        axes: int,
        slot: int,
        box: TargetBox,
        rate: Callable[[], float],
        lost: Callable[[float, float], None],
        bounds: Sequence[Bounds],
        share: float = 1.0,
    ) -> None:
        columns = cycle.bank.masks.columns(axes)
        self._cycle = cycle
        self._axes = axes
        self._box = box
        self._rate = rate
        self._lost = lost
        self._columns = np.array(columns, np.intp)
        self._seen = 0
        axes_led = [
            _bounded(followed_axis(cycle.machine.axes[column], share), each)
            for column, each in zip(columns, bounds, strict=True)
        ]
        self._follower = TargetFollower(
            axes_led,
            cycle.row.ordered[self._columns],
            at=cycle.time,
            cycle_s=cycle.cycle_s,
            unlimited=[
                each.low == -np.inf and bool(cycle.motions.unlimited >> column & 1)
                for column, each in zip(columns, bounds, strict=True)
            ],
        )
        for state, column, axis in zip(self._follower.states, columns, axes_led, strict=True):
            cycle.motions.follow(column, slot, state, MotionLimits.of(axis))

    def before(self, left: float, held: bool) -> float | None:  # noqa: ARG002
        """Let a cycle pass; all of ``left`` is left once the axes stand and no more targets are to come."""
        if left <= 0.0:
            # the barrier was made after this cycle's exchange
            return None
        now, follower = self._cycle.time, self._follower
        if self._box.count != self._seen:
            self._take()
        newest, closing = follower.newest, self._box.closing
        lost = newest is not None and not now <= newest.until
        if closing and follower.rests:
            # no more targets are to come, and the known ones end at rest
            lost = False
        follower.step(np.array([now]), 0.0 if newest is None or lost else self._rate())
        row = self._cycle.row
        row.ordered[self._columns] = follower.states[:, POSITION]
        row.ordered_velocity[self._columns] = follower.states[:, VELOCITY]
        if lost and newest is not None and not closing:
            # the step above was the first cycle of the stop
            self._lost(now - newest.stamp, newest.until - newest.stamp)
        elif closing and follower.stands and (lost or newest is None or follower.arrived):
            self._cycle.motions.drop(self._axes)
            return left
        return None

    def _take(self) -> None:
        count = self._box.count
        newest = self._box.newest(len(self._columns))
        # None where it was overwritten meanwhile: the next cycle reads the newest
        if newest is not None:
            self._seen = count
            self._follower.take(newest)


def _bounded(axis: Axis, bounds: Bounds) -> Axis:
    """Return an axis with its travel and speed restricted to bounds."""
    low, high, speed = bounds.within(Bounds(axis.min_position, axis.max_position, axis.max_velocity))
    return msgspec.structs.replace(axis, min_position=low, max_position=high, max_velocity=speed)
