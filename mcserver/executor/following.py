"""Axes that follow streamed targets: the barrier at which a program of servo mode stands.

What reaches it may be late, wrong or nothing: `follow_targets` keeps velocity, acceleration, jerk and travel
whatever it is, and a silence longer than the newest message counts ends the program by a stop within them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mcserver.executor.barriers import Barrier
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Array
from mcserver.executor.shm.target_box import POINTS, TargetBox, Targets
from mcserver.motion.kernels.target_tracking import (
    ACCELERATION,
    POSITION,
    VELOCITY,
    follow_targets,
    read_reference,
)

# Points that are less than this ahead are behind [cycles]; where all are, the last one is taken so far ahead.
AHEAD, NEXT = 0.5, 2.0


class Follows(Barrier):
    """The barrier at which u stands while axes follow targets.

    Args:
        axes: mask of columns, all energized and at rest. slot: whose they are. box: the targets.
        rate: the slot's share of speed, 0 in feed hold.
        lost: called once with the seconds since the newest targets came and those that they counted for,
            where no more have come in time; it stops the axes.
    """

    def __init__(
        self,
        cycle: Cycle,
        axes: int,
        slot: int,
        box: TargetBox,
        rate: Callable[[], float],
        lost: Callable[[float, float], None],
    ) -> None:
        columns = cycle.bank.masks.columns(axes)
        self._cycle = cycle
        self._axes = axes
        self._box = box
        self._rate = rate
        self._lost = lost
        self._columns = np.array(columns, np.intp)
        count = len(columns)
        self._states = np.zeros((count, 3))
        self._states[:, POSITION] = cycle.row.ordered[self._columns]
        self._limits = self._limits_of(columns)
        self._reference = self._states.copy()
        self._knots = np.zeros((POINTS + 1, 1 + 2 * count))
        self._count = 0
        self._seen = 0
        self._newest: Targets | None = None
        # when the reference was read last
        self._at = cycle.time
        for state, column in zip(self._states, columns, strict=True):
            cycle.motions.follow(column, slot, state)

    def _limits_of(self, columns: Sequence[int]) -> Array:
        limits = np.zeros((len(columns), 5))
        for limit, state, column in zip(limits, self._states, columns, strict=True):
            axis = self._cycle.machine.axes[column]
            low, high = axis.min_position, axis.max_position
            if self._cycle.motions.unlimited >> column & 1:
                low, high = -np.inf, np.inf
            # one that was energized outside its travel may come back, and go no further
            place = float(state[POSITION])
            limit[:] = (
                axis.max_velocity,
                axis.max_acceleration,
                axis.max_jerk,
                min(low, place),
                max(high, place),
            )
        return limits

    def before(self, left: float, held: bool) -> float | None:  # noqa: ARG002
        """Let a cycle pass; all of ``left`` is left once the axes stand and no more targets are to come."""
        if left <= 0.0:
            # it was put up behind this cycle's exchange
            return None
        now = self._cycle.time
        if self._box.count != self._seen:
            self._take()
        newest, closing = self._newest, self._box.closing
        lost = newest is not None and not now <= newest.until
        if closing and self._rests:
            # nobody is to speak any more, and the way is known to its end
            lost = False
        self._step(now, 0.0 if newest is None or lost else self._rate())
        if lost and newest is not None and not closing:
            # the stop goes on from the first cycle of it
            self._lost(now - newest.stamp, newest.until - newest.stamp)
        elif closing and self._ends(lost=lost):
            self._cycle.motions.drop(self._axes)
            return left
        return None

    @property
    def _rests(self) -> bool:
        """Whether the newest targets end at rest."""
        newest, first = self._newest, 1 + len(self._columns)
        return newest is not None and not newest.by_velocity and not newest.knots[-1, first:].any()

    def after(self, held: bool) -> bool:  # noqa: ARG002
        """Return False: targets pass by time alone."""
        return False

    def _take(self) -> None:
        """Lead the reference from where it is over the newest points that are ahead."""
        count = self._box.count
        newest = self._box.newest(len(self._columns))
        if newest is None:
            # overwritten meanwhile: the next cycle reads what has come
            return
        self._seen = count
        if not np.isfinite(newest.knots).all():
            return
        self._newest = newest
        at, cycle_s, knots = self._at, self._cycle.cycle_s, newest.knots
        ahead = knots[knots[:, 0] > at + AHEAD * cycle_s]
        if not len(ahead):
            ahead = knots[-1:].copy()
            axes = len(self._columns)
            passed = at + NEXT * cycle_s - ahead[0, 0]
            with np.errstate(over="ignore"):
                # what is beyond all numbers stops the axes
                ahead[0, 0] += passed
                ahead[0, 1 : 1 + axes] += passed * ahead[0, 1 + axes :]
        self._knots[0, 0] = at
        self._knots[0, 1:] = self._reference[:, :ACCELERATION].T.ravel()
        self._knots[1 : 1 + len(ahead)] = ahead
        self._count = 1 + len(ahead)

    def _step(self, now: float, rate: float) -> None:
        by_velocity = self._newest is not None and self._newest.by_velocity
        if self._count:
            read_reference(self._knots, self._count, now, by_velocity, self._reference)
        self._at = now
        follow_targets(self._states, self._reference, self._limits, rate, self._cycle.cycle_s, by_velocity)
        if by_velocity:
            # whatever positions come next begin where the axes are
            self._reference[:, POSITION] = self._states[:, POSITION]
        row = self._cycle.row
        row.ordered[self._columns] = self._states[:, POSITION]
        row.ordered_velocity[self._columns] = self._states[:, VELOCITY]

    def _ends(self, *, lost: bool) -> bool:
        """Return whether the axes stand where the last targets have them, or where those stopped counting."""
        if self._states[:, VELOCITY:].any():
            return False
        if lost or self._newest is None:
            return True
        arrived = self._at >= self._knots[self._count - 1, 0]
        return bool(arrived and (self._states == self._reference).all())
