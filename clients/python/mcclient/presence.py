"""Whether the server is there, and which start of it: from its liveliness tokens."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from functools import partial

from mcclient.keys import Server, server_of
from mcclient.transport import Arrived

OnReturn = Callable[[str], None]


class Presence:
    """Servers of one machine that are alive; one is believed as long as it is.

    Its token says which Zenoh session speaks for it, so that whatever comes from another one is known by it.
    """

    def __init__(self, machine: str, live_keys: Iterable[str] = ()) -> None:
        self._machine = machine
        self._alive: dict[Server, None] = {}
        for server in map(server_of, live_keys):
            if server.machine == machine:
                self._alive[server] = None
        self._changed = asyncio.Event()
        self._on_return: list[OnReturn] = []

    @property
    def online(self) -> bool:
        return bool(self._alive)

    @property
    def server(self) -> Server | None:
        """The one that has been alive for longest: another of the same name is not the one asked."""
        return next(iter(self._alive), None)

    def is_server(self, source: str | None) -> bool:
        """Return whether what came from this Zenoh id came from the server; nothing is believed while it is
        away.
        """
        return self.server is not None and source == self.server.session

    def on_return(self, call: OnReturn) -> Callable[[], None]:
        """``call`` is called with the instance whenever a token comes: at a start, and after a lost link.

        What is returned ends that.
        """
        self._on_return.append(call)
        return partial(self._on_return.remove, call)

    def on_token(self, arrived: Arrived) -> None:
        """A token has come or gone."""
        server = server_of(arrived.key)
        if server.machine != self._machine:
            return
        before = self.server
        if arrived.gone:
            self._alive.pop(server, None)
        else:
            self._alive[server] = None
        now = self.server
        # at a start, after a lost link, and where the server beside an ended one takes its place
        if now is not None and (now != before or (server == now and not arrived.gone)):
            for call in tuple(self._on_return):
                call(now.instance)
        self._changed.set()

    async def wait_for_change(self, timeout_s: float) -> None:
        """Until a token comes or goes, or the time is over."""
        self._changed.clear()
        try:
            async with asyncio.timeout(timeout_s):
                await self._changed.wait()
        except TimeoutError:
            return

    async def wait_online(self, timeout_s: float) -> bool:
        """Return whether the server is there within this time."""
        deadline = asyncio.get_running_loop().time() + timeout_s
        while not self.online:
            remaining = deadline - asyncio.get_running_loop().time()
            if remaining <= 0.0:
                return False
            await self.wait_for_change(remaining)
        return True
