"""Axes that follow others besides what programs order, as X of a gantry over a conveyor does (D-142).

The way of the leader, from where the two were coupled or from where an input rose, gives the axis its offset,
which goes after it within the share of the axis's limits that programs do not have. It is added to what is
shaped. Programs see the axis without it: they work in the frame that moves. Once the coupling has ended and
both are at rest, the offset counts as ordered, and where the axis stands is read anew.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from mcserver.executor.axes import AxisBank
from mcserver.executor.coupling import Coupling
from mcserver.executor.entries import Array
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.io_bank import IoBank
from mcserver.executor.target_follower import Bounds
from mcserver.machine.coupled_errors import Limits
from mcserver.machine.follow_section import Follow
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
        follow: Follow,
        columns: Sequence[int],
        slot: int,
        generation: int,
        noted: deque[float] | None,
        limits: Limits,
    ) -> None:
        own = follow.superimposed
        assert own is not None
        assert bank.shaper is not None
        rows = np.array([[*limits, own.low, own.high], [*limits, -np.inf, np.inf]])
        within = Bounds(own.low, own.high)
        super().__init__(machine, bank, follow, columns, slot, generation, 0.0, within, rows)
        self._shaper, self._noted, self._after = bank.shaper, noted, own.after
        self._masks = bank.masks
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
        """Let a cycle pass, behind which it is set what is added to the shaped setpoints."""
        self._move()
        self._add()

    def _move(self) -> None:
        """Move the offset."""
        if self.waits:
            self._look_for_work()
        elif self.ending:
            follow_targets(self._states, self._targets, self._limits, 0.0, self._cycle_s, False)
        else:
            self._go_after()

    def _add(self) -> None:
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

    @property
    def lacks_work(self) -> bool:
        return self.waits and self._noted is not None and not self._noted

    def brake(self, *, urgent: bool) -> None:
        """End with the offset coming to rest; ``urgent``: without regard to jerk."""
        self.ending = True
        if urgent:
            self._limits[:, MAX_JERK] = np.inf

    def rest(self) -> None:
        """Let the offset be at rest where it is: drives got no setpoints for a time."""
        self._states[:, 1:] = 0.0

    def lose(self) -> None:
        """Know that some of the axes follow no setpoints any more."""

    def release(self, held: int) -> dict[int, float]:
        """Let what is added, at rest, count as ordered, for columns that follow setpoints. Return it."""
        added: dict[int, float] = {}
        for column in self._masks.columns(self.axes):
            if held >> column & 1:
                added[column] = offset = float(self._shaper.added[column])
                self._row.ordered[column] += offset
                self._shaper.shift(column, offset)
            self._shaper.added[column] = self._shaper.added_velocity[column] = 0.0
        return added

    @property
    def rests(self) -> bool:
        """Whether the offset is at rest."""
        return not self.state[1:].any()

    def out_of_step(self) -> tuple[FaultCode, tuple[float, float]]:
        """Return code and values of the fault: of the window, where by its limits alone it kept up."""
        code, values = super().out_of_step()
        return (FaultCode.WINDOW_LEFT if code is not FaultCode.OUT_OF_STEP else code), values


class NotedWorks:
    """Where leaders were as inputs rose that say that a work comes, by what is to follow them."""

    def __init__(self, machine: Machine, bank: AxisBank) -> None:
        self._noted: dict[int, deque[float]] = {}
        # of each: the input's column, the leader's column and places
        self._latches: list[tuple[int, int, Array, deque[float]]] = []
        given = [(1 << column, axis.follow) for column, axis in enumerate(machine.axes)]
        given += [(machine.mask_of(tool.axes), tool.follow) for tool in machine.tools]
        for axes, follow in given:
            if follow is None or follow.superimposed is None or follow.superimposed.latch is None:
                continue
            places = bank.row.actual if follow.measured else bank.row.setpoint
            noted = self._noted[axes] = deque(maxlen=MOST_NOTED)
            leader = machine.column_of(follow.leader)
            self._latches.append((follow.superimposed.latch, leader, places, noted))
        # an input that is on at the start has not risen
        self._on = [True] * len(self._latches)

    def __bool__(self) -> bool:
        return bool(self._latches)

    def of(self, axes: int) -> deque[float] | None:
        """Return the works that a follower has not taken, the oldest first; None: no input notes them."""
        return self._noted.get(axes)

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
