"""Lines from a source that may block, such as a file or standard input, without blocking the loop."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterable, Iterator

TURN_LINES = 1000
TURN_S = 0.01


async def from_thread(lines: Iterable[str]) -> AsyncIterator[str]:
    """The same lines, read in another thread, some at a time; a slow source gives each line as it comes."""
    iterator = iter(lines)
    while True:
        some, ended = await asyncio.to_thread(_take_some, iterator)
        for line in some:
            yield line
        if ended:
            return


def _take_some(iterator: Iterator[str]) -> tuple[list[str], bool]:
    some: list[str] = []
    until = time.monotonic() + TURN_S
    for line in iterator:
        some.append(line)
        if len(some) >= TURN_LINES or time.monotonic() >= until:
            return some, False
    return some, True
