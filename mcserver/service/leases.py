"""Leases: which program may move which axes.

A program gets all its axes and one program slot at once, in the order of requests, and releases them at its
end. Since nothing is held while waiting for more, programs cannot deadlock. A waiting program keeps its
place: a later one passes it only if it needs none of its axes.

A program at a pause lends its axes for motion by hand, not to programs that wait for its end. They are
returned when the pause ends, which waits for the borrowers.

A planner that is behind may still put rows of a program that has ended into its slot. So the slot is not
granted again before the planner has forgotten the program: the rows would be played for another one.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from mcserver.executor.shm.mailbox import SLOTS


class Grant(msgspec.Struct, frozen=True):
    """A lease: the program, its axes, and its program slot."""

    program: str
    axes: frozenset[int]
    slot: int


class LeaseTable:
    """Holders and waiting programs. Pure bookkeeping without effect on motion."""

    def __init__(self, slots: int = SLOTS) -> None:
        self._free_slots = list(range(slots))
        # slots of ended programs that the planner has not forgotten yet
        self._left: dict[str, int] = {}
        self._held: dict[str, Grant] = {}
        self._waiting: dict[str, frozenset[int]] = {}
        # axes lent by programs at a pause, and the programs that may borrow
        self._lent: dict[str, frozenset[int]] = {}
        self._borrowers: set[str] = set()

    def request(self, program: str, axes: Iterable[int], *, at_pause: bool = False) -> list[Grant]:
        """Queue ``program`` for ``axes``; return what can start now (this program or nothing).

        Args:
            at_pause: it may borrow axes of a program at a pause.

        Raises:
            ValueError: no axis, or the program has requested already.
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
        """Lend axes that a program holds, while it is at a pause."""
        self._lent[program] = self._held[program].axes & frozenset(axes)

    def lent(self, program: str) -> frozenset[int]:
        """Return the axes that a program lends."""
        return self._lent.get(program, frozenset())

    def take_back(self, program: str) -> None:
        """End lending by a program; no other program may hold any of the axes."""
        self._lent.pop(program, None)

    def release(self, program: str, *, planned: bool) -> list[Grant]:
        """Release what ``program`` holds or waits for; return what can start now, in order.

        Args:
            planned: the planner may know it; its slot is then free only when `forgotten`.
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
        """Free the slot of an ended program whose planner puts no more rows (None: all such slots).

        Returns what can start now, in order.
        """
        for each in list(self._left) if program is None else [program]:
            slot = self._left.pop(each, None)
            if slot is not None:
                self._free_slots.append(slot)
        self._free_slots.sort()
        return self._grant()

    def holder(self, axis: int, *, at_pause: bool = False) -> str | None:
        """Return the program that holds ``axis``.

        Args:
            at_pause: ignore one that lends it.
        """
        lender: str | None = None
        for grant in self._held.values():
            if axis in grant.axes and axis not in self.lent(grant.program):
                return grant.program
            if axis in grant.axes:
                lender = grant.program
        return None if at_pause else lender

    def borrower(self, program: str) -> str | None:
        """Return the first program that holds, or waits for, axes lent by ``program``."""
        lent = self.lent(program)
        asked = {grant.program: grant.axes for grant in self._held.values()} | self._waiting
        # holders in order of grants, then waiting ones in order of requests
        return next((each for each in asked if each in self._borrowers and asked[each] & lent), None)

    def grant_of(self, program: str) -> Grant | None:
        """Return the lease of a program; None if it has none, or waits."""
        return self._held.get(program)

    def _grant(self) -> list[Grant]:
        # lent axes are only free for borrowers
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
            # axes of a waiting program are reserved: no later one takes them
            taken |= axes
            if borrows:
                moved |= axes
        return started
