"""Frames of a bus as they come, without sending any."""

from __future__ import annotations

import math
import select
import time
from collections.abc import Callable, Iterator
from typing import Protocol

from mcserver.can.port import ListeningPort

ROUND_S = 0.02
# Without a connection to wait for, a port is asked so often whether it is back.
AWAY_ROUND_S = 0.05


class _Described(Protocol):
    def fileno(self) -> int: ...


def wait_for_frames(port: _Described, wait: Callable[[float], object] = time.sleep) -> None:
    """Return once a frame may have come, within `ROUND_S`; where the bus is away, after `AWAY_ROUND_S`."""
    descriptor = port.fileno()
    if descriptor < 0:
        wait(AWAY_ROUND_S)
        return
    waiting = select.poll()
    waiting.register(descriptor, select.POLLIN)
    waiting.poll(ROUND_S * 1000.0)


def frames_of(
    port: ListeningPort, duration_s: float, silence_s: float = math.inf
) -> Iterator[tuple[float, int, bytes]]:
    """Yield (time [s] since the begin, identifier, payload) of every frame that comes within a duration.

    The times are those at which this process reads, milliseconds after the wire's. It ends where no frame
    comes for ``silence_s``.
    """
    began = time.monotonic()
    heard = 0.0
    while (now := time.monotonic() - began) < min(duration_s, heard + silence_s):
        wait_for_frames(port)
        now = time.monotonic() - began
        for identifier, payload in port.drain():
            heard = now
            yield now, identifier, bytes(payload)
