"""From Zenoh's threads to the asyncio loop.

A callback runs in a network thread that all traffic of the link waits for: it appends to a bounded deque and
wakes the loop, no more.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

BUDGET = 512

log = logging.getLogger(__name__)


class Inbox(Generic[T]):
    """A bounded queue into the loop; when full the oldest item goes, and ``dropped`` counts it.

    Args:
        loop: where ``deliver`` runs.
        deliver: called in the loop with each item, in order. What it raises is counted in ``failed``, logged
            the first time, and costs that item alone.
        limit: how many items wait at most.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, deliver: Callable[[T], None], *, limit: int) -> None:
        self.dropped = 0
        self.failed = 0
        self._loop = loop
        self._deliver = deliver
        self._items: deque[T] = deque(maxlen=limit)
        self._woken = False

    def push(self, item: T) -> None:
        """Appends; from any thread."""
        if len(self._items) == self._items.maxlen:
            self.dropped += 1
        self._items.append(item)
        # cleared by the loop before it pops: an item is either seen by that pass or wakes another one
        if not self._woken:
            self._woken = True
            try:
                self._loop.call_soon_threadsafe(self._drain)
            except RuntimeError:
                # the loop is closed: nobody is left to deliver to
                self._items.clear()

    def _drain(self) -> None:
        self._woken = False
        for _ in range(BUDGET):
            try:
                item = self._items.popleft()
            except IndexError:
                return
            try:
                self._deliver(item)
            except Exception:
                self.failed += 1
                if self.failed == 1:
                    log.exception("a message could not be handled; more of them are only counted")
        # a burst does not keep the loop from its other work
        if not self._woken:
            self._woken = True
            self._loop.call_soon(self._drain)
