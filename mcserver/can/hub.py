"""A small socketcand server without hardware: frames of a client go to all other clients of its channel.

``python -m mcserver.can.hub HOST:PORT [CHANNEL …]`` serves until SIGTERM; without names any channel may be
opened.
One thread, no waiting: what came in one round leaves in one write a client.
"""

from __future__ import annotations

import argparse
import enum
import logging
import os
import selectors
import signal
import socket
import sys
import time
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass, field

from mcserver.can.address import NAME, family_of, split_host_port
from mcserver.can.socketcand_text import ECHO, HI, MAX_MESSAGE, OK, frame_text, split_messages
from mcserver.processes import log_to_stderr

LOG = logging.getLogger(__name__)
MAX_CLIENTS = 256
MAX_CHANNELS = 64
# A client that lets so much wait does not read [bytes].
MAX_QUEUE = 1 << 20
RECEIVED_AT_ONCE = 1 << 16
# python-can takes `< ok >` for an error where a frame follows in the same packet: frames are held back until
# the client has said something, or for this time [s].
HOLD_S = 0.1


class Stage(enum.Enum):
    """What a client may say."""

    GREETED = 0
    OPEN = 1
    RAW = 2


@dataclass(eq=False)
class Client:
    """One connection; ``queue`` is what it has not been given yet, ``queued`` its length in bytes."""

    socket: socket.socket
    name: str
    stage: Stage = Stage.GREETED
    channel: str = ""
    text: bytes = b""
    queue: list[bytes] = field(default_factory=list)
    queued: int = 0
    held_until: float = 0.0
    writing: bool = False


@dataclass
class HubCounters:
    """Since the hub was opened. frames: taken from clients; malformed: messages answered by ``< error … >``;
    dropped: clients that did not read.
    """

    frames: int = 0
    malformed: int = 0
    dropped: int = 0


class Hub:
    """The server; `run` serves in the calling thread until `stop`."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0, channels: Collection[str] = ()) -> None:
        """Listens; port 0 takes a free one.

        Args:
            channels: names that can be opened; none: any name, at most `MAX_CHANNELS` at a time.

        Raises:
            OSError: the address cannot be listened on.
        """
        self._listener = socket.create_server((host, port), family=family_of(host), backlog=64)
        self._listener.setblocking(False)
        self.counters = HubCounters()
        self._named = frozenset(channels)
        self._members: dict[str, list[Client]] = {}
        self._clients: set[Client] = set()
        self._waiting: set[Client] = set()
        self._stopping = False
        self._lifeline = -1
        self._alarm, self._bell = socket.socketpair()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, None)
        self._selector.register(self._alarm, selectors.EVENT_READ, None)

    @property
    def port(self) -> int:
        port: int = self._listener.getsockname()[1]
        return port

    def end_with(self, descriptor: int) -> None:
        """End `run` once a pipe is closed by whoever holds its other end."""
        self._selector.register(descriptor, selectors.EVENT_READ, None)
        self._lifeline = descriptor

    def run(self) -> None:
        """Serve until `stop`, then close everything."""
        try:
            while not self._stopping:
                self._round()
        finally:
            self._close()

    def stop(self) -> None:
        """End `run`; from any thread or signal handler."""
        self._stopping = True
        with suppress(OSError):
            self._bell.send(b".")

    def _close(self) -> None:
        for client in list(self._clients):
            self._drop(client)
        self._selector.close()
        for opened in (self._listener, self._alarm, self._bell):
            opened.close()

    # ------------------------------------------------------------------ one round

    def _round(self) -> None:
        for key, events in self._selector.select(self._timeout()):
            client: Client | None = key.data
            if client is None:
                if key.fileobj is self._listener:
                    self._accept()
                elif key.fileobj == self._lifeline and not os.read(self._lifeline, 4096):
                    self._stopping = True
                continue
            if events & selectors.EVENT_WRITE:
                self._waiting.add(client)
            if events & selectors.EVENT_READ:
                self._read(client)
        if self._waiting:
            now = time.monotonic()
            for client in list(self._waiting):
                if client.held_until <= now:
                    self._waiting.discard(client)
                    self._write(client)

    def _timeout(self) -> float | None:
        if not self._waiting:
            return None
        return max(0.0, min(client.held_until for client in self._waiting) - time.monotonic())

    def _accept(self) -> None:
        try:
            connection, address = self._listener.accept()
        except OSError:
            return
        if len(self._clients) >= MAX_CLIENTS:
            LOG.warning("%s is turned away: %d clients are here", address, MAX_CLIENTS)
            connection.close()
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = Client(connection, f"{address[0]}:{address[1]}")
        self._clients.add(client)
        self._selector.register(connection, selectors.EVENT_READ, client)
        self._answer(client, HI)

    def _read(self, client: Client) -> None:
        try:
            text = client.socket.recv(RECEIVED_AT_ONCE)
        except BlockingIOError:
            return
        except OSError:
            text = b""
        if not text:
            self._drop(client)
            return
        client.held_until = 0.0
        messages, client.text = split_messages(client.text + text)
        now = time.time()
        timestamp = b"%.6f" % now
        frames: list[bytes] = []
        for message in messages:
            if client.stage is Stage.RAW:
                frame = frame_text(message, timestamp)
                if frame is not None:
                    frames.append(frame)
                    continue
            self._obey(client, message)
        if len(client.text) > MAX_MESSAGE:
            client.text = b""
            self._complain(client, "message too long")
        if frames:
            self.counters.frames += len(frames)
            self._spread(client, b"".join(frames))

    def _spread(self, sender: Client, text: bytes) -> None:
        for client in list(self._members.get(sender.channel, ())):
            if client is not sender:
                self._answer(client, text)

    # ------------------------------------------------------------------ commands

    def _obey(self, client: Client, message: bytes) -> None:
        words = message.split()
        if words == [b"<", b"echo"]:
            self._answer(client, ECHO)
        elif client.stage is Stage.GREETED and len(words) == 3 and words[:2] == [b"<", b"open"]:
            self._open(client, words[2].decode("ascii", "replace"))
        elif client.stage is Stage.OPEN and words == [b"<", b"rawmode"]:
            client.stage = Stage.RAW
            self._members.setdefault(client.channel, []).append(client)
            self._answer(client, OK)
            # the answer leaves at once, and alone
            self._waiting.discard(client)
            self._write(client)
            client.held_until = time.monotonic() + HOLD_S
        else:
            self._complain(client, "could not parse command" if words else "empty command")

    def _open(self, client: Client, channel: str) -> None:
        known = channel in self._members
        allowed = channel in self._named if self._named else known or len(self._members) < MAX_CHANNELS
        if not allowed or not NAME.fullmatch(channel):
            self._complain(client, "could not open bus")
            return
        client.stage = Stage.OPEN
        client.channel = channel
        self._members.setdefault(channel, [])
        self._answer(client, OK)

    def _complain(self, client: Client, why: str) -> None:
        self.counters.malformed += 1
        self._answer(client, b"< error " + why.encode("ascii") + b" >")

    # ------------------------------------------------------------------ writing

    def _answer(self, client: Client, text: bytes) -> None:
        client.queue.append(text)
        client.queued += len(text)
        if client.queued > MAX_QUEUE:
            LOG.warning("%s is dropped: it does not read (%d bytes wait)", client.name, client.queued)
            self.counters.dropped += 1
            self._drop(client)
            return
        if not client.writing:
            self._waiting.add(client)

    def _write(self, client: Client) -> None:
        if not client.queue:
            return
        text = client.queue[0] if len(client.queue) == 1 else b"".join(client.queue)
        try:
            sent = client.socket.send(text)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._drop(client)
            return
        client.queued -= sent
        client.queue.clear()
        if sent < len(text):
            client.queue.append(text[sent:])
        wants = bool(client.queue)
        if wants != client.writing:
            client.writing = wants
            events = selectors.EVENT_READ | (selectors.EVENT_WRITE if wants else 0)
            self._selector.modify(client.socket, events, client)

    def _drop(self, client: Client) -> None:
        if client not in self._clients:
            return
        self._clients.discard(client)
        self._waiting.discard(client)
        members = self._members.get(client.channel)
        if members is not None:
            if client in members:
                members.remove(client)
            if not members:
                del self._members[client.channel]
        self._selector.unregister(client.socket)
        client.socket.close()


def main(arguments: list[str] | None = None) -> int:
    """Return the hub as a process; the exit code: 0 ended by a signal, 1 the address is taken, 2 usage."""
    parser = argparse.ArgumentParser(
        prog="mcserver.can.hub", description="A socketcand server without hardware."
    )
    parser.add_argument("address", metavar="HOST:PORT", help="where to listen; port 0 takes a free one")
    parser.add_argument("channels", metavar="CHANNEL", nargs="*", help="names that can be opened; none: any")
    parser.add_argument(
        "--until-input-ends",
        action="store_true",
        help="end with whatever started this, seen by its closed pipe",
    )
    given = parser.parse_args(arguments)
    try:
        host, port = split_host_port(given.address)
    except ValueError as error:
        parser.error(f"{given.address!r} is no address: {error}")
    log_to_stderr(logging.INFO, "hub: %(message)s")
    try:
        hub = Hub(host, port, given.channels)
    except OSError as error:
        LOG.error("%s cannot be listened on: %s; choose another port", given.address, error.strerror)
        return 1
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: hub.stop())
    if given.until_input_ends:
        hub.end_with(sys.stdin.fileno())
    sys.stdout.write(f"READY hub on {host}:{hub.port}\n")
    sys.stdout.flush()
    hub.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
