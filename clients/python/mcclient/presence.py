"""Whether the server is there, and which start of it: from its liveliness tokens."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from mcclient.keys import machine_and_instance
from mcclient.transport import Arrived

OnReturn = Callable[[str], None]


class Presence:
    """Instances of one machine's server that are alive; the one that came last counts."""

    def __init__(self, machine: str) -> None:
        self._machine = machine
        self._alive: dict[str, None] = {}
        self._changed = asyncio.Event()
        self._on_return: list[OnReturn] = []

    @property
    def online(self) -> bool:
        return bool(self._alive)

    @property
    def instance(self) -> str | None:
        """The newest instance that is alive."""
        return next(reversed(self._alive), None)

    def on_return(self, call: OnReturn) -> None:
        """``call`` is called with the instance whenever a token comes: at a start, and after a lost link."""
        self._on_return.append(call)

    def on_token(self, arrived: Arrived) -> None:
        """A token has come or gone."""
        machine, instance = machine_and_instance(arrived.key)
        if machine != self._machine:
            return
        self._alive.pop(instance, None)
        if not arrived.gone:
            self._alive[instance] = None
            for call in self._on_return:
                call(instance)
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
