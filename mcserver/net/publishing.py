"""Publish from a separate thread.

A put waits a moment for each subscriber's link that is full: with many of them it takes milliseconds, for
which no call should wait.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable

from mcserver.net.defects import DefectLog
from mcserver.net.session import is_zenoh_fault

log = logging.getLogger(__name__)

WAITING = 4096
CLOSE_LIMIT_S = 1.0

Put = Callable[[bytes], None]


class PublishingThread:
    """Publishes messages in order.

    Args:
        name: of the thread.
        limit: most messages that may wait; further ones are dropped. Subscribers of events notice gaps in the
            numbers, and request the missing events.

    Attributes:
        dropped: count of dropped messages.
    """

    def __init__(self, name: str, limit: int = WAITING) -> None:
        self.dropped = 0
        self._waiting: queue.Queue[tuple[Put, bytes] | None] = queue.Queue(limit)
        self._failed = DefectLog(log)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, put: Put, payload: bytes) -> None:
        """Schedule a message; from any thread, without blocking."""
        try:
            self._waiting.put_nowait((put, payload))
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Publish what waits, and end the thread; within a time limit."""
        try:
            self._waiting.put(None, timeout=CLOSE_LIMIT_S)
        except queue.Full:
            return
        self._thread.join(CLOSE_LIMIT_S)

    def _run(self) -> None:
        while (item := self._waiting.get()) is not None:
            put, payload = item
            try:
                put(payload)
            except BaseException as error:
                if not is_zenoh_fault(error):
                    raise
                self._failed.add(f"nothing could be published: {error}")
