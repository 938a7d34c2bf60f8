"""Gantry pairs: one setpoint for two drives, and supervision of the skew between them.

The follower gets the leader's setpoint plus the difference that the two had when both were energized, so that
nothing jumps. Homing gives each side its own reference, and removes that difference.
"""

from __future__ import annotations

from mcserver.executor.axes import AxisBank
from mcserver.executor.independent import IndependentMotions
from mcserver.machine.machine_file import Machine


class GantryPair:
    """A leader and its follower.

    Args:
        leader, follower: columns. max_skew: [m or rad].
    """

    def __init__(self, bank: AxisBank, leader: int, follower: int, max_skew: float) -> None:
        self._row = bank.row
        self._bank = bank
        self.leader, self.follower, self.max_skew = leader, follower, max_skew
        self.mask = 1 << leader | 1 << follower
        # follower's setpoint minus leader's; undefined while the two are not tied
        self._ahead = 0.0
        self._tied = False
        # difference of the sides when they were energized
        self._start: float | None = None
        self._beyond = False

    def tie(self, moved: int) -> None:
        """Tie the follower to the leader from the next cycle on, if both hold and are at rest.

        Args:
            moved: columns in independent motion.
        """
        bank, row, leader, follower = self._bank, self._row, self.leader, self.follower
        if self.mask & ~(bank.energized & bank.positioned):
            self._tied, self._start = False, None
            return
        if self._start is None:
            self._start = float(row.actual[follower] - row.actual[leader])
        # a moving leader is not tied: the follower would jump to its speed
        if not self._tied and not moved & self.mask and row.ordered_velocity[leader] == 0.0:
            self._ahead = float(row.ordered[follower] - row.ordered[leader])
            self._tied = True

    def follow(self, moved: int) -> None:
        """Set the follower's setpoint of this cycle; ``moved``: as in `tie`."""
        row, leader, follower = self._row, self.leader, self.follower
        if self.mask & ~self._bank.energized or moved >> follower & 1:
            self._tied = False
        if self._tied:
            row.ordered[follower] = row.ordered[leader] + self._ahead
            row.ordered_velocity[follower] = row.ordered_velocity[leader]

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        more = distance * ((column == self.follower) - (column == self.leader))
        self._ahead += more
        if self._start is not None:
            self._start += more

    def skew(self, homed: int) -> float:
        """Return follower minus leader [m or rad].

        Unless both sides are homed, relative to that difference when they were energized.
        """
        difference = float(self._row.actual[self.follower] - self._row.actual[self.leader])
        return difference if not self.mask & ~homed else difference - (self._start or 0.0)

    def breaks(self, homed: int, moved: int) -> float | None:
        """Return a skew beyond the limit, when it first exceeds that and while the pair moves; else None.

        Args:
            homed: columns that have their references. moved: columns in independent motion.
        """
        if self._start is None:
            self._beyond = False
            return None
        skew = self.skew(homed)
        before, self._beyond = self._beyond, not abs(skew) <= self.max_skew
        moves = moved & self.mask or self._row.ordered_velocity[self.leader] != 0.0
        return skew if self._beyond and (not before or moves) else None


class GantryPairs:
    """All pairs of a machine."""

    def __init__(self, machine: Machine, bank: AxisBank, motions: IndependentMotions) -> None:
        self._motions = motions
        self.pairs = tuple(
            GantryPair(bank, machine.column_of(axis.gantry.leader), column, axis.gantry.max_skew)
            for column, axis in enumerate(machine.axes)
            if axis.gantry is not None
        )
        self.mask = sum(pair.mask for pair in self.pairs)

    def follow(self) -> None:
        """Set the setpoints of second drives in this cycle."""
        moved = self._motions.mask
        for pair in self.pairs:
            pair.follow(moved)

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        for pair in self.pairs:
            pair.shift(column, distance)

    def broken(self, homed: int) -> list[tuple[GantryPair, float]]:
        """Return the pairs whose skew exceeds its limit by the fresh feedback, each with the skew."""
        for pair in self.pairs:
            pair.tie(self._motions.mask)
        found = ((pair, pair.breaks(homed, self._motions.mask)) for pair in self.pairs)
        return [(pair, skew) for pair, skew in found if skew is not None]
