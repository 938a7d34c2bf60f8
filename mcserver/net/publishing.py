"""Publications that leave from a thread of their own.

A put goes to each subscriber's link in turn, and waits a moment for each that is full: with a crowd of them
it takes milliseconds, which no call is to wait for.
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
    """Puts messages in the order in which they were given.

    Args:
        name: of the thread.
        limit: how many may wait; what comes beyond is dropped. Subscribers of events notice by the numbers,
            and ask for them again.

    Attributes:
        dropped: messages for which there was no room.
    """

    def __init__(self, name: str, limit: int = WAITING) -> None:
        self.dropped = 0
        self._waiting: queue.Queue[tuple[Put, bytes] | None] = queue.Queue(limit)
        self._failed = DefectLog(log)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, put: Put, payload: bytes) -> None:
        """Publish soon; from any thread, without blocking."""
        try:
            self._waiting.put_nowait((put, payload))
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Publish what waits, and end; within a limit."""
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
