"""Leases: which program may move which axes.

A program gets all its axes and one executor slot at once, in the order of asking, and gives them back at its
end. Since nothing is ever held while waiting for more, programs cannot deadlock. A program that waits keeps
its place: one behind it passes only if it needs none of its axes.

A program that stands at a pause lends its axes: to what a person does by hand meanwhile, not to programs that
wait for its end. They come back when the pause ends, which waits for whoever has them.

A planner that is behind may still put rows for a program that has ended into the slot that was its own. So
nobody gets that slot before the planner has forgotten the program: the rows would be played for another one.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from mcserver.executor.shm.mailbox import SLOTS


class Grant(msgspec.Struct, frozen=True):
    """A lease: the program, its axes, and the executor's slot that plays it."""

    program: str
    axes: frozenset[int]
    slot: int


class LeaseTable:
    """Who holds and who waits. Plain bookkeeping; nothing here moves anything.

    Args:
        slots: how many programs can run side by side.
    """

    def __init__(self, slots: int = SLOTS) -> None:
        self._free_slots = list(range(slots))
        # slots of programs that have ended and that the planner knows still
        self._left: dict[str, int] = {}
        self._held: dict[str, Grant] = {}
        self._waiting: dict[str, frozenset[int]] = {}
        # axes of programs that stand at a pause, and the programs that may have such axes
        self._lent: dict[str, frozenset[int]] = {}
        self._borrowers: set[str] = set()

    def request(self, program: str, axes: Iterable[int], *, at_pause: bool = False) -> list[Grant]:
        """Queue ``program`` for ``axes``; return what can start now (this program or nothing).

        Args:
            at_pause: it may have axes of a program that stands at a pause.

        Raises:
            ValueError: no axis, or the program has asked already.
        """
        wanted = frozenset(axes)
        if not wanted:
            raise ValueError("a lease needs an axis")
        if program in self._held or program in self._waiting:
            raise ValueError(f"program {program} has asked for its axes already")
        self._waiting[program] = wanted
        if at_pause:
            self._borrowers.add(program)
        return self._grant()

    def lend(self, program: str, axes: Iterable[int]) -> None:
        """Let others have axes that a program holds, as long as it stands at a pause."""
        self._lent[program] = self._held[program].axes & frozenset(axes)

    def lent(self, program: str) -> frozenset[int]:
        """Return the axes that a program lends."""
        return self._lent.get(program, frozenset())

    def take_back(self, program: str) -> None:
        """End what a program lends; no other one may hold any of it."""
        self._lent.pop(program, None)

    def release(self, program: str, *, planned: bool) -> list[Grant]:
        """Give back what ``program`` holds or waits for; return what can start now, in order.

        Args:
            planned: the planner may know it; then its slot is free only once it is `forgotten`.
        """
        self._waiting.pop(program, None)
        self._borrowers.discard(program)
        self._lent.pop(program, None)
        grant = self._held.pop(program, None)
        if grant is not None:
            self._left[program] = grant.slot
            if not planned:
                return self.forgotten(program)
        return self._grant()

    def forgotten(self, program: str | None) -> list[Grant]:
        """The planner puts nothing any more for a program that has ended; None: for any of them. Returns what
        can start now, in order.
        """
        for each in list(self._left) if program is None else [program]:
            slot = self._left.pop(each, None)
            if slot is not None:
                self._free_slots.append(slot)
        self._free_slots.sort()
        return self._grant()

    def holder(self, axis: int, *, at_pause: bool = False) -> str | None:
        """Return the program that has ``axis``.

        Args:
            at_pause: leave out one that lends it.
        """
        lender: str | None = None
        for grant in self._held.values():
            if axis in grant.axes and axis not in self.lent(grant.program):
                return grant.program
            if axis in grant.axes:
                lender = grant.program
        return None if at_pause else lender

    def borrower(self, program: str) -> str | None:
        """Return the first program that has, or waits for, axes that ``program`` lends."""
        lent = self.lent(program)
        asked = {grant.program: grant.axes for grant in self._held.values()} | self._waiting
        # in the order in which they got them, then in which they wait
        return next((each for each in asked if each in self._borrowers and asked[each] & lent), None)

    def grant_of(self, program: str) -> Grant | None:
        """Return what a program holds; None: nothing, or it waits."""
        return self._held.get(program)

    def _grant(self) -> list[Grant]:
        # what is lent is free for those that may have it only
        taken: set[int] = set()
        moved: set[int] = set()
        for grant in self._held.values():
            taken |= grant.axes
            moved |= grant.axes - self.lent(grant.program)
        started: list[Grant] = []
        for program, axes in list(self._waiting.items()):
            if not self._free_slots:
                break
            borrows = program in self._borrowers
            if not axes & (moved if borrows else taken):
                grant = Grant(program, axes, self._free_slots.pop(0))
                del self._waiting[program]
                self._held[program] = grant
                started.append(grant)
            # axes of one that waits are spoken for: none behind it takes them
            taken |= axes
            if borrows:
                moved |= axes
        return started
