"""Messages over a stream socket between two processes; neither side ever waits for the other."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
from collections.abc import Callable

# Most bytes that one call reads from the socket.
READ_BYTES = 1 << 18
_LENGTH = struct.Struct("<I")


class MessagePipe:
    """One end of a pipe; buffers what the socket does not take at once, and sends it by `flush`.

    Args:
        end: a connected socket, which the pipe owns from now on.
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
        """Queue a message for the next `flush`."""
        self._unsent += _LENGTH.pack(len(payload))
        self._unsent += payload

    def send(self, payload: bytes) -> None:
        """Queue a message and flush.

        Raises:
            OSError: the other end is gone.
        """
        self.queue(payload)
        self.flush()

    def flush(self) -> None:
        """Send queued messages, as far as the socket takes them. Raises OSError as `send`."""
        try:
            while self._unsent:
                sent = self._socket.send(self._unsent)
                del self._unsent[:sent]
        except BlockingIOError:
            return

    def receive(self) -> list[bytes]:
        """Return the messages that have arrived, in order; a bounded number of bytes per call.

        Raises:
            EOFError: the other end has closed, or is gone; all messages before have been returned.
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
        """Close this end; the other one can still read all that was sent."""
        self._socket.close()


class WatchedPipe:
    """A pipe that an event loop reads, and writes to as far as the other end takes it.

    Args:
        pipe: this end; its creator closes it, after `release`.
        on_readable: called in the loop while something can be received.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, pipe: MessagePipe, on_readable: Callable[[], None]
    ) -> None:
        self._loop = loop
        self._pipe = pipe
        self._writing = False
        # whether messages wait for the loop's next turn
        self._due = False
        loop.add_reader(pipe.fileno(), on_readable)

    def send(self, payload: bytes) -> None:
        """Queue a message, to be sent in the loop's next turn or by `flush`.

        If the other end is gone, it is dropped; reading reports that end.
        """
        self._pipe.queue(payload)
        if not self._due:
            self._due = True
            self._loop.call_soon(self.flush)

    def flush(self) -> None:
        """Send queued messages, as far as the other end takes them now."""
        if self._due:
            self._due = False
            self._flush()

    def release(self) -> None:
        """Stop reading and writing, after sending what can be sent at once."""
        self.flush()
        self._loop.remove_reader(self._pipe.fileno())
        self._loop.remove_writer(self._pipe.fileno())

    def _flush(self) -> None:
        pipe = self._pipe
        with contextlib.suppress(OSError):
            pipe.flush()
        if pipe.blocked == self._writing:
            return
        self._writing = pipe.blocked
        if self._writing:
            self._loop.add_writer(pipe.fileno(), self._flush)
        else:
            self._loop.remove_writer(pipe.fileno())
