"""What ports on sockets of the kernel share: buffers, giving up a bus that is away, and opening it again."""

from __future__ import annotations

import socket
import time
from abc import ABC, abstractmethod
from typing import ClassVar

from mcserver.can.frame import PAYLOAD_OFFSET, filled_frame, prepare_frame
from mcserver.can.port import PortCounters

REOPEN_S = 0.1


class SocketPort(ABC):
    """The part of a `CanPort` that does not depend on the kind of socket.

    Attributes:
        GONE: error numbers of the system that mean that the bus is away. The sockets are given back then, and
            opened again at most every `REOPEN_S`.
    """

    payload_offset = PAYLOAD_OFFSET
    GONE: ClassVar[frozenset[int]]

    def __init__(self) -> None:
        self.counters = PortCounters()
        # receives; None while the bus is away
        self._socket: socket.socket | None = None
        self._closed = False
        self._next_try = 0.0

    @abstractmethod
    def _open(self) -> None:
        """Open all sockets, or none.

        Raises:
            OSError: the bus is away.
        """

    @abstractmethod
    def send_prepared(self, buffer: bytearray) -> bool:
        """As `CanPort.send_prepared`."""

    def fileno(self) -> int:
        return -1 if self._socket is None else self._socket.fileno()

    def prepare(self, identifier: int, length: int) -> bytearray:
        return prepare_frame(identifier, length)

    def send(self, identifier: int, payload: bytes) -> bool:
        return self.send_prepared(filled_frame(identifier, payload))

    def close(self) -> None:
        self._closed = True
        self._give_back()

    def _give_back(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _failed(self, error: OSError) -> None:
        """A system call failed; the sockets are given up where the bus is away."""
        self.counters.errors += 1
        if error.errno in self.GONE:
            self.counters.down = True
            self._give_back()
            self._next_try = time.monotonic() + REOPEN_S

    def _reopen(self) -> bool:
        now = time.monotonic()
        if self._closed or now < self._next_try:
            return False
        self._next_try = now + REOPEN_S
        try:
            self._open()
        except OSError:
            return False
        self.counters.down = False
        return True
