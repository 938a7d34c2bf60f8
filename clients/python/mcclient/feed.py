"""An async iterator over what arrives, with a bound."""

from __future__ import annotations

import asyncio
import weakref
from collections import deque
from collections.abc import Callable
from typing import Generic, Self, TypeVar

T = TypeVar("T")


class Queue(Generic[T]):
    """What waits for its reader: bounded, the oldest goes first when full."""

    def __init__(self, limit: int) -> None:
        self.missed = 0
        self.items: deque[T] = deque(maxlen=limit)
        self.closed = False
        self._arrived = asyncio.Event()

    def push(self, item: T) -> None:
        if len(self.items) == self.items.maxlen:
            self.missed += 1
        self.items.append(item)
        self._arrived.set()

    def end(self) -> None:
        """No more comes; what is there can still be read."""
        self.closed = True
        self._arrived.set()

    async def take(self) -> T:
        """Raises StopAsyncIteration at the end."""
        while not self.items:
            if self.closed:
                raise StopAsyncIteration
            self._arrived.clear()
            await self._arrived.wait()
        return self.items.popleft()


class Feed(Generic[T]):
    """``async for item in feed``; it listens from its making on, until closed or no longer referenced.

    Attributes:
        missed: items that came faster than they were read, and are lost.
    """

    def __init__(self, queue: Queue[T], release: Callable[[], None]) -> None:
        self._queue = queue
        self._finalizer = weakref.finalize(self, release)

    @property
    def missed(self) -> int:
        return self._queue.missed

    def close(self) -> None:
        """Stops listening; a reader that waits sees the end."""
        self._finalizer()
        self._queue.end()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> T:
        return await self._queue.take()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()
