"""canopen's network over one of our ports, so that both paths of the server share one way onto the bus.

python-can's own reader is not used: it ends for good at the first exception of a listener, and for a lost
connection some of its interfaces spin.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import canopen
from can import CanOperationError

from mcserver.can.port import CanPort, PortCounters

log = logging.getLogger(__name__)

OnPayload = Callable[[bytes], None]


class PortNetwork(canopen.Network):
    """Sends from any thread; one thread calls `receive`.

    Attributes:
        failures: frames whose handling raised; they are left out.
    """

    def __init__(self, port: CanPort) -> None:
        super().__init__()
        self.failures = 0
        self._port = port
        self._port_lock = threading.Lock()
        self._handlers: dict[int, OnPayload] = {}
        self.lss_lock = threading.Lock()
        self._observer: Callable[[int, bytes], None] | None = None
        self._transfers = 0
        self._transfer_lock = threading.Lock()

    @contextmanager
    def awaited(self) -> Iterator[None]:
        """Somebody waits for an answer: frames are taken as they come."""
        with self._transfer_lock:
            self._transfers += 1
        try:
            yield
        finally:
            with self._transfer_lock:
                self._transfers -= 1

    @property
    def is_awaited(self) -> bool:
        """Whether anybody waits for an answer."""
        return self._transfers > 0

    @property
    def counters(self) -> PortCounters:
        return self._port.counters

    def fileno(self) -> int:
        """For `select`; −1 while the bus is away."""
        return self._port.fileno()

    def handle(self, identifier: int, handler: OnPayload) -> None:
        """Call ``handler`` with the payload of every frame of that identifier, in the receiving thread."""
        self._handlers[identifier] = handler

    def observe(self, observer: Callable[[int, bytes], None] | None) -> None:
        """Show every frame that comes to ``observer`` too, in the receiving thread; None: to nobody."""
        self._observer = observer

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame.

        Raises:
            CanOperationError: it is gone: the bus is away or has no room.
        """
        if remote:
            raise CanOperationError("remote frames are not sent")
        with self._port_lock:
            sent = self._port.send(can_id, bytes(data))
        if not sent:
            raise CanOperationError("the frame found no room, or the bus is away")

    def try_send(self, identifier: int, payload: bytes) -> bool:
        """As `send_message`; False: it is gone."""
        with self._port_lock:
            return self._port.send(identifier, payload)

    def receive(self) -> None:
        """Hand over what has come; never waits, never raises for what a frame holds."""
        with self._port_lock:
            frames = self._port.drain()
        observer = self._observer
        for identifier, payload in frames:
            if observer is not None:
                observer(identifier, bytes(payload))
            handler = self._handlers.get(identifier)
            if handler is None:
                continue
            try:
                handler(bytes(payload))
            except Exception:
                # one frame that nobody foresaw must not stop the bus
                self.failures += 1
                if self.failures == 1:
                    log.exception("frame %03X# %s could not be handled", identifier, bytes(payload).hex())

    def disconnect(self) -> None:
        """Give the port back; a second call does nothing."""
        with self._port_lock:
            self._port.close()
