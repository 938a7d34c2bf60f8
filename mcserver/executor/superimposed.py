"""Axes that follow others besides what programs order, as X of a gantry over a conveyor does (D-142).

The way of the leader, from where the two were coupled or from where an input rose, gives the axis its offset,
which goes after it within the share of the axis's limits that programs do not have. Programs see the axis
without it: they work in the frame that moves. Once the coupling has ended and both are at rest, the offset
counts as ordered, and where the axis stands is read anew.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from mcserver.executor.axes import AxisBank
from mcserver.executor.coupling import Coupling
from mcserver.executor.entries import Array
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.io_bank import IoBank
from mcserver.executor.target_follower import Bounds
from mcserver.machine.machine_file import Machine
from mcserver.motion.kernels.target_tracking import MAX_JERK, VELOCITY, follow_targets

# Works between the input that notes them and the axis that takes them; of more the oldest is forgotten.
MOST_NOTED = 256


class SuperimposedCoupling(Coupling):
    """A follower that programs move, too.

    Args:
        noted: where the leader was as the works came that nobody has taken, the oldest first; None: the work
            is where it is now.
    """

    superimposed = True

    def __init__(
        self,
        machine: Machine,
        bank: AxisBank,
        column: int,
        slot: int,
        generation: int,
        noted: deque[float] | None,
    ) -> None:
        own = machine.axes[column].superimposed
        assert own is not None
        assert bank.shaper is not None
        limits = np.array([[*own.limits, own.low, own.high], [*own.limits, -np.inf, np.inf]])
        super().__init__(machine, bank, column, slot, generation, 0.0, Bounds(own.low, own.high), limits)
        self._shaper, self._noted, self._after = bank.shaper, noted, own.after
        # it waits for a work: the leader's place at which the offset is 0 is not known yet
        self.waits = noted is not None

    def _begin(self, place: float) -> None:
        """Let the offset be 0 where the leader is at a place."""
        self._ahead = -self._curve.at(place - self.leader.shifted)[0]
        self.waits = False

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on; the offset stays."""
        if column == self.leader.column:
            self.leader.shift(distance)

    def step(self) -> None:
        """Let a cycle pass, behind which the axis's offset is set."""
        if self.waits:
            self._look_for_work()
        elif self.ending:
            follow_targets(self._states, self._targets, self._limits, 0.0, self._cycle_s, False)
        else:
            self._go_after()
        self._shaper.added[self.column] = self.state[0]
        self._shaper.added_velocity[self.column] = self.state[VELOCITY]

    def _look_for_work(self) -> None:
        """Take the oldest work that has come to where it is followed; forget those that have left again."""
        place = self.leader.look()[0] + self.leader.shifted
        noted = self._noted
        while noted and not self.ending:
            start = noted[0] + self._after
            way = place - start
            if way * (self._after or way) < 0.0:
                return
            noted.popleft()
            offset = self._curve.at(place - start)[0]
            if self._within.low <= offset <= self._within.high:
                self._begin(start)
                return

    def brake(self, *, urgent: bool) -> None:
        """End with the offset coming to rest; ``urgent``: without regard to jerk."""
        self.ending = True
        if urgent:
            self._limits[:, MAX_JERK] = np.inf

    def rest(self) -> None:
        """Let the offset be at rest where it is: drives got no setpoints for a time."""
        self._states[:, 1:] = 0.0

    def release(self, *, held: bool) -> float:
        """Let the offset, at rest, count as ordered; ``held``: the axis follows setpoints. Return it."""
        offset = float(self.state[0]) if held else 0.0
        self._shaper.added[self.column] = self._shaper.added_velocity[self.column] = 0.0
        if offset:
            self._row.ordered[self.column] += offset
            self._shaper.shift(self.column, offset)
        return offset

    @property
    def rests(self) -> bool:
        """Whether the offset is at rest."""
        return not self.state[1:].any()

    def out_of_step(self) -> tuple[FaultCode, tuple[float, float]]:
        """Return code and values of the fault: of the window, where by its limits alone it kept up."""
        code, values = super().out_of_step()
        return (FaultCode.WINDOW_LEFT if code is not FaultCode.OUT_OF_STEP else code), values


class NotedWorks:
    """Where leaders were as inputs rose that say that a work comes, by the axes that are to follow it."""

    def __init__(self, machine: Machine, bank: AxisBank) -> None:
        self._noted: dict[int, deque[float]] = {}
        # of each: the input's column, whether it was on, the leader's column and places
        self._latches: list[tuple[int, int, Array, deque[float]]] = []
        for column, axis in enumerate(machine.axes):
            follow, own = axis.follow, axis.superimposed
            if follow is None or own is None or own.latch is None:
                continue
            places = bank.row.actual if follow.measured else bank.row.ordered
            noted = self._noted[column] = deque(maxlen=MOST_NOTED)
            leader = machine.column_of(follow.leader)
            self._latches.append((own.latch, leader, places, noted))
        # an input that is on at the start has not risen
        self._on = [True] * len(self._latches)

    def __bool__(self) -> bool:
        return bool(self._latches)

    def of(self, column: int) -> deque[float] | None:
        """Return the works that a follower has not taken, the oldest first; None: no input notes them."""
        return self._noted.get(column)

    def note(self, io: IoBank) -> None:
        """Look at the inputs of a cycle."""
        for number, (latch, leader, places, noted) in enumerate(self._latches):
            on = io.value(latch) > 0.5
            if on and not self._on[number]:
                noted.append(float(places[leader]))
            self._on[number] = on

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        for _, leader, _, noted in self._latches:
            if leader == column:
                noted.extend([noted.popleft() + distance for _ in range(len(noted))])
