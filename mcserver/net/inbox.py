"""Pass items from Zenoh's threads to the asyncio loop.

A callback runs in one of Zenoh's network threads, for which all traffic of that link waits. So it only
appends to a bounded deque, and wakes the loop once for everything until the loop's next turn.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from mcserver.net.defects import DefectLog

log = logging.getLogger(__name__)

T = TypeVar("T")

# longest delivery in one turn of the loop; the rest waits for the next turn
BUDGET_S = 0.005


class Inbox(Generic[T]):
    """A bounded queue into the loop.

    Args:
        loop: in which ``deliver`` runs.
        deliver: called in the loop with each item, in order. Its errors are counted in ``failed`` and logged,
            and affect only that item.
        limit: further items go to ``refuse`` instead, in the thread that pushes them.
        refuse: called with items beyond the limit; counted in ``refused``.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        deliver: Callable[[T], None],
        *,
        limit: int,
        refuse: Callable[[T], None] | None = None,
    ) -> None:
        self.refused = 0
        self.failed = DefectLog(log)
        self._loop = loop
        self._deliver = deliver
        self._limit = limit
        self._refuse = refuse
        self._items: deque[T] = deque()
        self._woken = False

    def push(self, item: T) -> None:
        """Append an item; from any thread."""
        if len(self._items) >= self._limit:
            self.refused += 1
            if self._refuse is not None:
                self._refuse(item)
            return
        self._items.append(item)
        # set here, cleared by the loop before it pops: an item is either seen by that pass or wakes another
        if not self._woken:
            self._woken = True
            self._wake()

    def _wake(self) -> None:
        try:
            self._loop.call_soon_threadsafe(self._drain)
        except RuntimeError:
            # the loop is closed: nobody is left to deliver to
            self._items.clear()

    def _drain(self) -> None:
        self._woken = False
        items = self._items
        until = time.monotonic() + BUDGET_S
        while items:
            item = items.popleft()
            try:
                self._deliver(item)
            except Exception as error:
                self.failed.add(f"a message could not be handled: {error}", error)
            if time.monotonic() >= until:
                break
        # let the loop do other work between parts of a burst
        if items and not self._woken:
            self._woken = True
            self._loop.call_soon(self._drain)
