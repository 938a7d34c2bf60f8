"""What ports on sockets of the kernel share: sending and taking frames, and opening a lost bus again."""

from __future__ import annotations

import errno
import socket
import time
from abc import ABC, abstractmethod
from typing import ClassVar

from mcserver.can.frame import PAYLOAD_OFFSET, filled_frame, prepare_frame
from mcserver.can.port import MAX_DRAINED, Frame, PortCounters

REOPEN_S = 0.1
# There is no room now.
FULL = frozenset((errno.EAGAIN, errno.ENOBUFS))


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
    def _transmit(self, buffer: bytearray) -> None:
        """Send a prepared frame. Raises: OSError."""

    @abstractmethod
    def _receive(self) -> Frame | None:
        """Take what has come next; None: it is no frame, or none of the others'. Raises: OSError."""

    def send_prepared(self, buffer: bytearray) -> bool:
        if self._socket is None and not self._reopen():
            self.counters.unsent += 1
            return False
        try:
            self._transmit(buffer)
        except OSError as error:
            self.counters.unsent += 1
            if error.errno not in FULL:
                self._failed(error)
            return False
        self.counters.sent += 1
        return True

    def drain(self) -> list[Frame]:
        frames: list[Frame] = []
        if self._socket is None and not self._reopen():
            return frames
        for _ in range(MAX_DRAINED):
            try:
                frame = self._receive()
            except BlockingIOError:
                break
            except OSError as error:
                self._failed(error)
                break
            if frame is not None:
                frames.append(frame)
        self.counters.received += len(frames)
        return frames

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
