"""Events of every machine that can be reached, asked for by number: none is missed on the way."""

from __future__ import annotations

import asyncio
import logging
from typing import Protocol

from mcclient import Event, MotionError
from mcclient.types import EventsReply

log = logging.getLogger(__name__)

# Machines that are asked at the same time.
AT_ONCE = 32
# A number that no event has: the answer says only which is the newest.
BEYOND = 2**53


class EventSource(Protocol):
    """What is asked: `mcclient.fleet.FleetLink`, or a fake in the tests."""

    async def find(self, *, timeout_s: float) -> list[str]: ...
    async def events(self, machine: str, since: int, limit: int = 1000) -> EventsReply: ...


class FleetEvents:
    """Where each machine's events have been read to, over one link after another.

    Args:
        history: begin with what a server still has, not with what happens from now on.
    """

    def __init__(self, *, history: bool) -> None:
        self._history = history
        self._next: dict[str, tuple[str, int]] = {}
        self._first_look = True

    async def poll(self, link: EventSource, timeout_s: float) -> list[tuple[str, Event]]:
        """Machine and event of all that is new, each machine's in order.

        Raises:
            MotionError: the network cannot be asked.
        """
        names = await link.find(timeout_s=timeout_s)
        room = asyncio.Semaphore(AT_ONCE)

        async def ask(name: str) -> list[tuple[str, Event]]:
            async with room:
                try:
                    return [(name, event) for event in await self._new_of(link, name)]
                except MotionError as error:
                    log.info("%s: %s", name, error.message)
                    return []

        found = [each for some in await asyncio.gather(*map(ask, names)) for each in some]
        self._first_look = False
        return found

    async def _new_of(self, link: EventSource, name: str) -> list[Event]:
        known = self._next.get(name)
        if known is None and self._first_look and not self._history:
            page = await link.events(name, BEYOND)
            self._next[name] = (page.instance, page.newest + 1)
            return []
        # a machine that comes later is new from its first event on
        instance, since = known or ("", 0)
        page = await link.events(name, since)
        if page.instance != instance and known is not None:
            # another start of its server counts from 1
            page = await link.events(name, 0)
        if not page.events:
            self._next[name] = (page.instance, max(since, 1) if page.instance == instance else 1)
            return []
        self._next[name] = (page.instance, page.events[-1].seq + 1)
        return list(page.events)
