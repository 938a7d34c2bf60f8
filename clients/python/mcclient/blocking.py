"""Asynchronous objects for callers that wait: carried out by a loop in a thread of its own."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from functools import wraps
from typing import Any, Concatenate, Generic, ParamSpec, Self, TypeVar

from mcclient.feed import Feed

P = ParamSpec("P")
T = TypeVar("T")


class LoopThread:
    """A loop that runs in a thread until it is stopped."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="mcclient", daemon=True)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Return the result; when the caller is interrupted, the work is cancelled."""
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def stop(self) -> None:
        async def wind_up() -> None:
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            await asyncio.get_running_loop().shutdown_default_executor()

        self.run(wind_up())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


class Stream(Generic[T]):
    """``for item in stream``; it listens from its making on, until closed."""

    def __init__(self, loop: LoopThread, feed: Feed[T]) -> None:
        self._loop = loop
        self._feed = feed

    def close(self) -> None:
        async def close() -> None:
            self._feed.close()

        self._loop.run(close())

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        try:
            return self._loop.run(self._feed.__anext__())
        except StopAsyncIteration:
            raise StopIteration from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Blocking(Generic[T]):
    """Something asynchronous, and the loop that it lives in."""

    def __init__(self, loop: LoopThread, inner: T) -> None:
        self._loop = loop
        self._inner = inner


def waited(
    method: Callable[Concatenate[Any, P], Awaitable[T]],
) -> Callable[Concatenate[Blocking[Any], P], T]:
    """Make the same method for callers that wait for its end."""

    @wraps(method)
    def call(self: Blocking[Any], /, *arguments: P.args, **options: P.kwargs) -> T:
        async def work() -> T:
            return await method(self._inner, *arguments, **options)

        return self._loop.run(work())

    return call
