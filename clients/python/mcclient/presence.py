"""Whether the server is there, and which start of it: from its liveliness tokens."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable

from mcclient.keys import machine_and_instance
from mcclient.transport import Arrived

OnReturn = Callable[[str], None]


class Presence:
    """Instances of one machine's server that are alive; one is believed as long as it is.

    The instance is the server's Zenoh id, so that whatever comes from another session is known by it.
    """

    def __init__(self, machine: str, live_keys: Iterable[str] = ()) -> None:
        self._machine = machine
        self._alive: dict[str, None] = {}
        for key in live_keys:
            name, instance = machine_and_instance(key)
            if name == machine:
                self._alive[instance] = None
        self._changed = asyncio.Event()
        self._on_return: list[OnReturn] = []

    @property
    def online(self) -> bool:
        return bool(self._alive)

    @property
    def instance(self) -> str | None:
        """The instance that has been alive for longest: another of the same name is not the one asked."""
        return next(iter(self._alive), None)

    def is_server(self, source: str | None) -> bool:
        """Whether what came from this Zenoh id came from the server; nothing is believed while it is away."""
        return source is not None and source == self.instance

    def on_return(self, call: OnReturn) -> None:
        """``call`` is called with the instance whenever a token comes: at a start, and after a lost link."""
        self._on_return.append(call)

    def on_token(self, arrived: Arrived) -> None:
        """A token has come or gone."""
        machine, instance = machine_and_instance(arrived.key)
        if machine != self._machine:
            return
        before = self.instance
        if arrived.gone:
            self._alive.pop(instance, None)
        else:
            self._alive[instance] = None
        now = self.instance
        # at a start, after a lost link, and where the instance beside an ended one takes its place
        if now is not None and (now != before or (instance == now and not arrived.gone)):
            for call in self._on_return:
                call(now)
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
        """Whether the server is there within this time."""
        deadline = asyncio.get_running_loop().time() + timeout_s
        while not self.online:
            remaining = deadline - asyncio.get_running_loop().time()
            if remaining <= 0.0:
                return False
            await self.wait_for_change(remaining)
        return True
