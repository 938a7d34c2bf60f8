"""Detect a router that is reachable but refuses the session, because another one has its Zenoh id.

Whoever gets a reply learns the id of the session that sent it, and a router accepts one session per id. After
a router's restart a stranger who connects with that id first would lock the machine out. A session that is
refused is replaced by one with a new id, which nobody knows before it is connected.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Iterable, Sequence

from mcserver.net.sockets import port_of

log = logging.getLogger(__name__)

LOOK_S = 1.0
# consecutive checks with a reachable router and no link; Zenoh itself retries at least every two seconds
REFUSED_LOOKS = 4
# pause before the next new session, doubled each time: a refused certificate must not cut others' links
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
PROBE_S = 1.0
# protocols with which a connection can be tried
_STREAMS = frozenset({"tcp", "tls", "ws"})


class LinkWatch:
    """Watches a session's links to its endpoints.

    Args:
        connect: the endpoints; a link to one of them is enough.
        sources: returns this side's locators of the session's links.
        listened: locators that it listens on, whose links were opened by others.
        reopen: replaces the session.
        is_there: whether something accepts connections at an endpoint.
    """

    def __init__(
        self,
        connect: Sequence[str],
        sources: Callable[[], Iterable[str]],
        listened: Sequence[str],
        reopen: Callable[[], Awaitable[None]],
        is_there: Callable[[str], Awaitable[bool]],
    ) -> None:
        self._connect = tuple(connect)
        self._sources = sources
        self._listened = {port_of(locator) for locator in listened}
        self._reopen = reopen
        self._is_there = is_there
        self._refused = 0
        self._pause_s = FIRST_PAUSE_S

    async def run(self) -> None:
        """Check periodically until cancelled."""
        while True:
            await asyncio.sleep(LOOK_S)
            if await self.look():
                await asyncio.sleep(self._pause_s)
                self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)

    async def look(self) -> bool:
        """Check once; return whether the session was replaced."""
        if any(port_of(source) not in self._listened for source in self._sources()):
            self._refused, self._pause_s = 0, FIRST_PAUSE_S
            return False
        there = await asyncio.gather(*(self._is_there(endpoint) for endpoint in self._connect))
        self._refused = self._refused + 1 if any(there) else 0
        if self._refused < REFUSED_LOOKS:
            return False
        self._refused = 0
        log.warning("a router is there and has no link to this server: connecting anew with another Zenoh id")
        await self._reopen()
        return True


async def accepts_connections(endpoint: str) -> bool:
    """Return whether something listens at an endpoint; True for protocols without connections, where it is
    unknown.
    """
    protocol, _, address = endpoint.partition("/")
    if protocol not in _STREAMS:
        return True
    host, _, port = address.partition("?")[0].partition("#")[0].rpartition(":")
    try:
        async with asyncio.timeout(PROBE_S):
            _, writer = await asyncio.open_connection(host.strip("[]"), int(port))
    except (OSError, ValueError, TimeoutError):
        return False
    writer.close()
    with contextlib.suppress(OSError):
        await writer.wait_closed()
    return True
