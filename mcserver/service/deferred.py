"""A result that comes later, handed over at once.

An `asyncio.Future` gives its result in the loop's next round, and a task adds another round: too long a way
for what clients ask for all the time.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from typing import Any, Generic, TypeVar

T = TypeVar("T")
U = TypeVar("U")


class Deferred(Generic[T]):
    """One result or error, for one listener; belongs to the loop."""

    def __init__(self) -> None:
        self._outcome: tuple[T | None, Exception | None] | None = None
        self._listener: Callable[[T | None, Exception | None], None] | None = None

    @property
    def done(self) -> bool:
        return self._outcome is not None

    @property
    def value(self) -> T | None:
        """The result, where it has come already and is no error."""
        return None if self._outcome is None else self._outcome[0]

    def resolve(self, value: T) -> None:
        """Give the result; a second one is ignored."""
        self._settle(value, None)

    def fail(self, error: Exception) -> None:
        """Give an error instead."""
        self._settle(None, error)

    def listen(self, listener: Callable[[T | None, Exception | None], None]) -> None:
        """``listener(value, error)`` is called once: now, or when the result comes."""
        if self._outcome is not None:
            listener(*self._outcome)
        else:
            self._listener = listener

    def then(self, convert: Callable[[T], U]) -> Deferred[U]:
        """The same with another value; an error stays as it is."""
        converted: Deferred[U] = Deferred()

        def settle(value: T | None, error: Exception | None) -> None:
            if error is not None:
                converted.fail(error)
            else:
                converted.resolve(convert(value))  # type: ignore[arg-type]

        self.listen(settle)
        return converted

    def __await__(self) -> Generator[Any, None, T]:
        future: asyncio.Future[T] = asyncio.get_running_loop().create_future()

        def settle(value: T | None, error: Exception | None) -> None:
            if future.done():
                return
            if error is not None:
                future.set_exception(error)
            else:
                future.set_result(value)  # type: ignore[arg-type]

        self.listen(settle)
        return (yield from future)

    def _settle(self, value: T | None, error: Exception | None) -> None:
        if self._outcome is None:
            self._outcome = (value, error)
            if self._listener is not None:
                self._listener(value, error)
