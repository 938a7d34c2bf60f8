"""Every frame of some buses, in the order in which they came."""

from __future__ import annotations

import selectors
import threading
from collections.abc import Sequence
from dataclasses import dataclass

from mcserver.can.open import open_port
from mcserver.can.port import CanPort

# minutes at the rates of these tests
MOST_FRAMES = 1_000_000
LOOK_S = 0.05


@dataclass(frozen=True)
class Logged:
    """One frame; ``bus`` counts the addresses from 0."""

    bus: int
    identifier: int
    payload: bytes


class BusLog:
    """Listens on buses with ports of its own, in a thread, from its making until `close`."""

    def __init__(self, addresses: Sequence[str]) -> None:
        self._ports = [open_port(address) for address in addresses]
        self._frames: list[Logged] = []
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bus log", daemon=True)
        self._thread.start()

    @property
    def length(self) -> int:
        """Frames so far: where a later look may begin."""
        return len(self._frames)

    def frames(self, begin: int = 0) -> list[Logged]:
        """All from the one of that number on."""
        return self._frames[begin:]

    def close(self) -> None:
        self._stopping.set()
        self._thread.join()
        for port in self._ports:
            port.close()

    def _run(self) -> None:
        while not self._stopping.is_set():
            with selectors.DefaultSelector() as waiting:
                for port in self._ports:
                    if port.fileno() >= 0:
                        waiting.register(port.fileno(), selectors.EVENT_READ)
                if not waiting.get_map() or len(waiting.get_map()) < len(self._ports):
                    self._stopping.wait(LOOK_S)
                waiting.select(LOOK_S)
            for bus, port in enumerate(self._ports):
                self._take(bus, port)

    def _take(self, bus: int, port: CanPort) -> None:
        for identifier, payload in port.drain():
            if len(self._frames) < MOST_FRAMES:
                self._frames.append(Logged(bus, identifier, payload))
