"""Messages over a stream socket between two processes; neither side ever waits for the other."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
from collections.abc import Callable

# Bytes taken from the socket in one go; what remains is taken in the next.
READ_BYTES = 1 << 18
_LENGTH = struct.Struct("<I")


class MessagePipe:
    """One end. What the socket does not take at once is kept here, and sent by `flush`.

    Args:
        end: connected; belongs to the pipe from now on.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._socket = end
        self._received = bytearray()
        self._unsent = bytearray()

    def fileno(self) -> int:
        """Descriptor to select or poll."""
        return self._socket.fileno()

    @property
    def blocked(self) -> bool:
        """Whether something waits to be sent."""
        return bool(self._unsent)

    @property
    def waiting(self) -> int:
        """Bytes that wait to be sent."""
        return len(self._unsent)

    def queue(self, payload: bytes) -> None:
        """Keep a message behind those before it, for the next `flush`."""
        self._unsent += _LENGTH.pack(len(payload))
        self._unsent += payload

    def send(self, payload: bytes) -> None:
        """Send a message behind those before it.

        Raises:
            OSError: the other end is gone.
        """
        self.queue(payload)
        self.flush()

    def flush(self) -> None:
        """Send what waits, as far as the socket takes it. Raises OSError as `send`."""
        try:
            while self._unsent:
                sent = self._socket.send(self._unsent)
                del self._unsent[:sent]
        except BlockingIOError:
            return

    def receive(self) -> list[bytes]:
        """Take the messages that have come, in order; a bounded number of bytes a call.

        Raises:
            EOFError: the other end has closed, or is gone; all messages before have been taken.
        """
        try:
            part = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return []
        except OSError as error:
            raise EOFError from error
        if not part:
            raise EOFError
        received = self._received
        received += part
        messages, at = [], 0
        while len(received) - at >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(received, at)
            if len(received) - at - _LENGTH.size < length:
                break
            at += _LENGTH.size
            messages.append(bytes(received[at : at + length]))
            at += length
        del received[:at]
        return messages

    def close(self) -> None:
        """Close this end; the other one reads to the end of what was sent."""
        self._socket.close()


class WatchedPipe:
    """A pipe that an event loop reads, and writes to as far as the other end takes it.

    Args:
        pipe: this end; who made it closes it, after `release`.
        on_readable: called in the loop while something can be received.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, pipe: MessagePipe, on_readable: Callable[[], None]
    ) -> None:
        self._loop = loop
        self._pipe = pipe
        self._writing = False
        self._due = False
        # the loop flushes when it comes round
        self._scheduled = False
        loop.add_reader(pipe.fileno(), on_readable)

    def send(self, payload: bytes) -> None:
        """Send a message behind those before it, once the loop comes round, or with `flush`.

        To an end that is gone nothing goes, which is read.
        """
        self._pipe.queue(payload)
        self._due = True
        if not self._scheduled:
            self._scheduled = True
            self._loop.call_soon(self._come_round)

    def _come_round(self) -> None:
        self._scheduled = False
        self.flush()

    def flush(self) -> None:
        """Send what waits, as far as the other end takes it now."""
        if not self._due:
            return
        self._due = False
        self._flush()

    def release(self) -> None:
        """Read and write no more, but for what can be sent at once."""
        self.flush()
        self._loop.remove_reader(self._pipe.fileno())
        self._loop.remove_writer(self._pipe.fileno())

    def _flush(self) -> None:
        with contextlib.suppress(OSError):
            self._pipe.flush()
        self._watch_writing()

    def _watch_writing(self) -> None:
        pipe = self._pipe
        if pipe.blocked == self._writing:
            return
        self._writing = pipe.blocked
        if self._writing:
            self._loop.add_writer(pipe.fileno(), self._flush)
        else:
            self._loop.remove_writer(pipe.fileno())
