"""A link that a test can cut: a TCP proxy on the loopback."""

from __future__ import annotations

import contextlib
import re
import socket
import threading


class CuttableLink:
    """Forwards connections to an address; `cut` breaks those that are open.

    Args:
        address: a URL, or an endpoint of Zenoh such as ``tcp/127.0.0.1:7447``.

    Attributes:
        address: the same address through the link.
    """

    def __init__(self, address: str) -> None:
        host_and_port = re.search(r"([\d.]+):(\d+)", address)
        assert host_and_port is not None
        self._target = (host_and_port[1], int(host_and_port[2]))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = address.replace(host_and_port[0], f"127.0.0.1:{self._listener.getsockname()[1]}", 1)
        self._open: list[socket.socket] = []
        self._there = threading.Event()
        self._there.set()
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self, seconds: float = 0.0) -> None:
        """Break every connection that is open, and each new one until ``seconds`` have passed."""
        if seconds:
            self._there.clear()
            timer = threading.Timer(seconds, self._there.set)
            timer.daemon = True
            timer.start()
        while self._open:
            each = self._open.pop()
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def wait(self) -> None:
        """Until the link is there again."""
        self._there.wait()

    def close(self) -> None:
        self._listener.close()
        self.cut()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            if not self._there.is_set():
                near.close()
                continue
            try:
                far = socket.create_connection(self._target)
            except OSError:
                near.close()
                continue
            self._open += [near, far]
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._forward, args=(source, sink), daemon=True).start()

    def _forward(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)
        for each in (source, sink):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
