"""A port on a channel of a socketcand server: TCP, raw mode, never waiting once it is open.

A lost connection makes the port `down`; `drain` and `send` connect again, step by step, at most every
`RECONNECT_S`.
"""

from __future__ import annotations

import enum
import os
import select
import socket
import time
from contextlib import suppress

from mcserver.can.frame import HEADER, PAYLOAD_OFFSET, prepare_frame
from mcserver.can.port import MAX_DRAINED, Frame, PortCounters
from mcserver.can.socketcand_text import (
    ECHO,
    MAX_MESSAGE,
    RAW_MODE,
    SHORTEST_FRAME,
    frame_of,
    send_text,
    split_messages,
)
from mcserver.errors import RuntimeFault

OPEN_S = 5.0
RECONNECT_S = 0.25
# A connection that has not reached raw mode by then is given up.
HANDSHAKE_S = 2.0
# Unanswered packets end a connection: the server's computer may be gone without a word [ms].
UNANSWERED_MS = 2000
RECEIVED_AT_ONCE = 8192
MAX_UNSENT_BYTES = 4096


class Stage(enum.Enum):
    """How far a connection has come."""

    AWAY = 0
    CONNECTING = 1
    GREETING = 2
    OPENING = 3
    ENTERING_RAW = 4
    READY = 5


class SocketcandPort:
    """One client of one channel. The server does not give a client its own frames."""

    payload_offset = PAYLOAD_OFFSET

    def __init__(self, host: str, port: int, channel: str, open_s: float = OPEN_S) -> None:
        """Connect, and wait at most ``open_s`` for raw mode.

        Raises:
            RuntimeFault: MC424 nobody answers there, or the server refuses the channel.
        """
        self._where = f"socketcand:{host}:{port}/{channel}"
        self._channel = channel
        self.counters = PortCounters(down=True)
        self._stage = Stage.AWAY
        self._socket: socket.socket | None = None
        self._text = b""
        self._unsent = b""
        self._early: list[Frame] = []
        self._refusal = ""
        self._next_try = 0.0
        self._deadline = 0.0
        self._closed = False
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except OSError as error:
            raise self._cannot_open(error.strerror or str(error)) from error
        # resolved once: a look-up could wait in the realtime thread
        self._family, self._address = found[0][0], found[0][4]
        self._await_raw_mode(time.monotonic() + open_s)

    def fileno(self) -> int:
        return -1 if self._socket is None else self._socket.fileno()

    def prepare(self, identifier: int, length: int) -> bytearray:
        return prepare_frame(identifier, length)

    def send(self, identifier: int, payload: bytes) -> bool:
        return self._send_text(send_text(identifier, payload))

    def send_prepared(self, buffer: bytearray) -> bool:
        identifier, length = HEADER.unpack_from(buffer)
        return self._send_text(send_text(identifier, buffer[PAYLOAD_OFFSET : PAYLOAD_OFFSET + length]))

    def drain(self) -> list[Frame]:
        # what came together with the last answer of the handshake
        frames, self._early = self._early, []
        if self._stage is not Stage.READY and not self._advance(frames):
            return frames
        self._receive(frames)
        return frames

    def close(self) -> None:
        self._closed = True
        self._give_back()

    # ------------------------------------------------------------------ sending

    def _send_text(self, text: bytes) -> bool:
        if self._stage is not Stage.READY and not self._advance(None):
            self.counters.unsent += 1
            return False
        if self._unsent:
            self._write(b"")
            if len(self._unsent) > MAX_UNSENT_BYTES:
                self.counters.unsent += 1
                return False
        if self._socket is None or not self._write(text):
            self.counters.unsent += 1
            return False
        self.counters.sent += 1
        return True

    def _write(self, text: bytes) -> bool:
        """Give text to the connection; the rest of a message that has begun to leave waits here."""
        assert self._socket is not None
        waiting = self._unsent + text if self._unsent else text
        try:
            count = self._socket.send(waiting)
        except BlockingIOError:
            count = 0
        except OSError:
            self._lost()
            return False
        self._unsent = waiting[count:]
        return True

    # ------------------------------------------------------------------ receiving

    def _receive(self, frames: list[Frame]) -> None:
        while self._socket is not None:
            room = min(RECEIVED_AT_ONCE, (MAX_DRAINED - len(frames)) * SHORTEST_FRAME - len(self._text))
            if room <= 0:
                return
            try:
                text = self._socket.recv(room)
            except BlockingIOError:
                return
            except OSError:
                text = b""
            if not text:
                self._lost()
                return
            messages, rest = split_messages(self._text + text)
            if len(rest) > MAX_MESSAGE:
                self.counters.malformed += 1
                rest = b""
            self._text = rest
            for message in messages:
                self._take(message, frames)
                if self._socket is None:
                    return

    def _take(self, message: bytes, frames: list[Frame]) -> None:
        if self._stage is not Stage.READY:
            self._shake_hands(message.split())
            return
        frame = frame_of(message)
        if frame is not None:
            self.counters.received += 1
            frames.append(frame)
            return
        words = message.split()
        if words[1:] in ([b"echo"], [b"ok"]):
            return
        if words[1:2] == [b"error"]:
            self.counters.errors += 1
        else:
            self.counters.malformed += 1

    # ------------------------------------------------------------------ connecting

    def _advance(self, frames: list[Frame] | None) -> bool:
        """One step towards raw mode, without waiting; whether it is reached.

        Args:
            frames: takes what comes right behind the last answer; None: nothing is read now.
        """
        now = time.monotonic()
        if self._stage is Stage.AWAY:
            if self._closed or now < self._next_try:
                return False
            self._connect(now)
        elif now > self._deadline:
            self._lost()
            return False
        if self._stage is Stage.CONNECTING and self._is_connected():
            self._stage = Stage.GREETING
        if frames is not None and self._stage not in (Stage.AWAY, Stage.CONNECTING):
            self._receive(frames)
        return self._stage is Stage.READY

    def _connect(self, now: float) -> None:
        self._deadline = now + HANDSHAKE_S
        self._next_try = now + RECONNECT_S
        flags = socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
        try:
            opened = socket.socket(self._family, flags)
        except OSError:
            self.counters.errors += 1
            return
        with suppress(OSError):
            opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNANSWERED_MS)
        self._socket = opened
        self._stage = Stage.CONNECTING
        self._text = self._unsent = b""
        try:
            opened.connect(self._address)
        except BlockingIOError:
            return
        except OSError as error:
            self._refusal = error.strerror or str(error)
            self._lost()

    def _is_connected(self) -> bool:
        assert self._socket is not None
        writable = select.poll()
        writable.register(self._socket, select.POLLOUT)
        if not writable.poll(0):
            return False
        pending = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if pending:
            self._refusal = os.strerror(pending)
            self._lost()
            return False
        return True

    def _shake_hands(self, words: list[bytes]) -> None:
        if self._stage is Stage.GREETING and words == [b"<", b"hi"]:
            self._stage = Stage.OPENING
            self._write(b"< open " + self._channel.encode("ascii") + b" >")
        elif self._stage is Stage.OPENING and words == [b"<", b"ok"]:
            self._stage = Stage.ENTERING_RAW
            self._write(RAW_MODE)
        elif self._stage is Stage.ENTERING_RAW and words == [b"<", b"ok"]:
            self._stage = Stage.READY
            self.counters.down = False
            # tells a server that holds frames back until its answer is read that it has been
            self._write(ECHO)
        else:
            self._refusal = b" ".join(words[1:]).decode("ascii", "replace") or "no socketcand server"
            self._lost()

    def _lost(self) -> None:
        self.counters.errors += 1
        self.counters.down = True
        self._give_back()
        self._next_try = max(self._next_try, time.monotonic() + RECONNECT_S)

    def _give_back(self) -> None:
        self._stage = Stage.AWAY
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _await_raw_mode(self, deadline: float) -> None:
        while not self._advance(self._early):
            remaining = deadline - time.monotonic()
            if self._stage is Stage.AWAY or remaining <= 0.0:
                self.close()
                raise self._cannot_open(self._refusal or "no answer")
            waiting = select.poll()
            connecting = self._stage is Stage.CONNECTING
            waiting.register(self.fileno(), select.POLLOUT if connecting else select.POLLIN)
            waiting.poll(min(remaining, HANDSHAKE_S) * 1000.0)

    def _cannot_open(self, why: str) -> RuntimeFault:
        return RuntimeFault(
            "MC424",
            f"the CAN bus {self._where} cannot be opened: {why}",
            "check that a socketcand server runs there and has that channel",
        )
