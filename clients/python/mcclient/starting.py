"""What is started asynchronously, with and without a block."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Generator
from contextlib import AbstractAsyncContextManager
from typing import Any, Generic, TypeVar

T = TypeVar("T", bound=AbstractAsyncContextManager[Any])


class Starting(Generic[T]):
    """``async with start() as thing``, or ``thing = await start()`` for whoever ends it himself."""

    def __init__(self, start: Callable[[], Coroutine[Any, Any, T]]) -> None:
        self._start = start
        self._started: T | None = None

    def __await__(self) -> Generator[Any, None, T]:
        return self._start().__await__()

    async def __aenter__(self) -> T:
        self._started = await self._start()
        await self._started.__aenter__()
        return self._started

    async def __aexit__(self, *raised: Any) -> None:
        assert self._started is not None, "a block is left after it was entered"
        await self._started.__aexit__(*raised)
