"""A hub in a thread, and ports that are waited for."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator

from mcserver.can.hub import Hub
from mcserver.can.port import CanPort, Frame

LIMIT_S = 20.0


@contextlib.contextmanager
def running_hub(*channels: str, port: int = 0) -> Iterator[Hub]:
    """A hub that serves until the block's end."""
    hub = Hub(port=port, channels=channels)
    thread = threading.Thread(target=hub.run)
    thread.start()
    try:
        yield hub
    finally:
        hub.stop()
        thread.join(LIMIT_S)
        assert not thread.is_alive()


def address_of(hub: Hub, channel: str = "can0") -> str:
    return f"socketcand:127.0.0.1:{hub.port}/{channel}"


def receive(port: CanPort, count: int) -> list[Frame]:
    """Waits for so many frames."""
    frames: list[Frame] = []
    end = time.monotonic() + LIMIT_S
    while len(frames) < count:
        remaining = end - time.monotonic()
        assert remaining > 0.0, f"only {len(frames)} of {count} frames came: {frames}"
        poller = select.poll()
        if port.fileno() >= 0:
            poller.register(port.fileno(), select.POLLIN)
        poller.poll(min(20.0, remaining * 1e3))
        frames += port.drain()
    return frames


def wait_until(condition: Callable[[], object], what: str) -> None:
    """Asks again and again, for a bounded time."""
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end, f"not in time: {what}"
        time.sleep(0.005)


class RawClient:
    """A client of the hub that says what it is given, and nothing else."""

    def __init__(self, hub: Hub, receive_buffer: int | None = None) -> None:
        self.socket = socket.socket()
        if receive_buffer is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(LIMIT_S)
        self.socket.connect(("127.0.0.1", hub.port))
        self._text = b""

    def __enter__(self) -> RawClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def say(self, text: str) -> None:
        self.socket.sendall(text.encode())

    def hear(self) -> str:
        """The next message; empty where the hub has hung up."""
        while b">" not in self._text:
            received = self.socket.recv(4096)
            if not received:
                return ""
            self._text += received
        message, _, self._text = self._text.partition(b">")
        return message.decode() + ">"

    def enter(self, channel: str = "can0") -> None:
        """Goes to raw mode."""
        assert self.hear() == "< hi >"
        self.say(f"< open {channel} >")
        assert self.hear() == "< ok >"
        self.say("< rawmode >")
        assert self.hear() == "< ok >"
