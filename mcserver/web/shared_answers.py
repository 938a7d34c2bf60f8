"""Answers of a machine that several viewers want: asked for once in a while, however many look."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar, cast

T = TypeVar("T")


class SharedAnswers:
    """The newest answer to each question.

    Args:
        clock: seconds, never stepping.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._known: dict[str, tuple[float, asyncio.Future[Any]]] = {}

    async def get(self, question: str, period_s: float, ask: Callable[[], Awaitable[T]]) -> T:
        """Return an answer that is at most ``period_s`` old, or what ``ask`` says now; its errors too."""
        now = self._clock()
        known = self._known.get(question)
        if known is None or (known[1].done() and now - known[0] >= period_s):
            known = (now, asyncio.ensure_future(ask()))
            self._known[question] = known
            # whoever has asked may be gone by then
            known[1].add_done_callback(_look_at)
        # a viewer that leaves takes the answer from nobody else
        return cast("T", await asyncio.shield(known[1]))

    def forget(self, question: str) -> None:
        """Ask anew next time."""
        self._known.pop(question, None)


def _look_at(answer: asyncio.Future[Any]) -> None:
    """Take note of an error that nobody waits for any more."""
    if not answer.cancelled():
        answer.exception()
