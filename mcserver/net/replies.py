"""Send replies so that a caller that accepts none of them blocks nobody else's.

A reply blocks while its caller's link is full, until Zenoh closes that link; so does dropping a query, which
tells its caller that no reply comes. So neither is done in the loop: a few threads send, at most one reply
per caller at a time.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable

import msgspec

log = logging.getLogger(__name__)

# most replies sent at once: more callers would have to be stuck at the same time to delay another one
SENDERS = 16
CALLER_REPLIES = 256
# waiting behind the reply that is being sent, which may be larger: the simulation of a long program
CALLER_BYTES = 4 * 1024 * 1024
TOTAL_BYTES = 128 * 1024 * 1024

Send = Callable[[], None]


class Outgoing(msgspec.Struct, frozen=True):
    """A waiting reply.

    Attributes:
        size: of its payload [bytes]. send: sends it; may block. drop: drops it; may block.
    """

    size: int
    send: Send
    drop: Send


class _Lane(msgspec.Struct):
    """One caller's replies, in order; the first one is being sent."""

    replies: deque[Outgoing]
    size: int = 0


class ReplySender:
    """Sends replies from separate threads, those of one caller in order.

    Args:
        senders: most replies that may block before one of another caller waits. Threads are started as
            needed.
        caller_replies, caller_bytes: bounds of what may wait for one caller; a further reply is dropped, and
            its caller asks again.

    Attributes:
        dropped: count of dropped replies.
    """

    def __init__(
        self,
        *,
        senders: int = SENDERS,
        caller_replies: int = CALLER_REPLIES,
        caller_bytes: int = CALLER_BYTES,
    ) -> None:
        self.dropped = 0
        self._senders = senders
        self._caller_replies = caller_replies
        self._caller_bytes = caller_bytes
        self._lock = threading.Lock()
        self._lanes: dict[str, _Lane] = {}
        self._ready: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._idle = 0
        self._size = 0
        self._closed = False
        self._discarded: queue.SimpleQueue[Send | None] = queue.SimpleQueue()
        self._discarder: threading.Thread | None = None

    def has_room(self, caller: str) -> bool:
        """Return whether another reply to this caller would be accepted; checked before any work for it."""
        if caller not in self._lanes:
            return True
        with self._lock:
            lane = self._lanes.get(caller)
            return lane is None or self._fits(lane, 0)

    def discard(self, drop: Send) -> None:
        """Drop a query without a reply; from any thread, without blocking."""
        self.dropped += 1
        self._discarded.put(drop)
        with self._lock:
            if self._discarder is None and not self._closed:
                self._discarder = self._started("reply-discard", self._discard_all)

    def push(self, caller: str, reply: Outgoing) -> None:
        """Queue a reply; from any thread, without blocking."""
        with self._lock:
            taken = self._take(caller, reply)
        if not taken:
            self.discard(reply.drop)

    def close(self) -> None:
        """Accept no more replies; a blocked thread ends when its link does."""
        with self._lock:
            self._closed = True
            waiting = [reply for lane in self._lanes.values() for reply in list(lane.replies)[1:]]
            for lane in self._lanes.values():
                while len(lane.replies) > 1:
                    lane.replies.pop()
            for _ in self._threads:
                self._ready.put(None)
        for reply in waiting:
            self._discarded.put(reply.drop)
        self._discarded.put(None)
        if self._discarder is None:
            self._discard_all()

    def join(self, limit_s: float) -> None:
        """Wait for the threads to end, after `close` and the end of the session, which unblocks them.

        A thread that the interpreter ends inside Zenoh would abort the process.
        """
        until = time.monotonic() + limit_s
        for thread in (*self._threads, *((self._discarder,) if self._discarder is not None else ())):
            thread.join(max(0.0, until - time.monotonic()))

    def _take(self, caller: str, reply: Outgoing) -> bool:
        lane = self._lanes.get(caller)
        if self._closed or self._size + reply.size > TOTAL_BYTES:
            return False
        if lane is None:
            lane = self._lanes[caller] = _Lane(deque())
        elif not self._fits(lane, reply.size):
            return False
        lane.replies.append(reply)
        lane.size += reply.size
        self._size += reply.size
        if len(lane.replies) == 1:
            self._ready.put(caller)
            if self._idle < self._ready.qsize() and len(self._threads) < self._senders:
                self._threads.append(self._started(f"reply-{len(self._threads) + 1}", self._run))
        return True

    def _started(self, name: str, run: Callable[[], None]) -> threading.Thread:
        thread = threading.Thread(target=run, name=name, daemon=True)
        thread.start()
        return thread

    def _fits(self, lane: _Lane, size: int) -> bool:
        behind = lane.size - lane.replies[0].size
        return len(lane.replies) < self._caller_replies and behind + size <= self._caller_bytes

    def _discard_all(self) -> None:
        while (drop := self._discarded.get()) is not None:
            try:
                drop()
            except BaseException:
                # catch panics of Zenoh, too: others' queries follow
                log.exception("a query could not be given up")

    def _run(self) -> None:
        while True:
            with self._lock:
                self._idle += 1
            caller = self._ready.get()
            with self._lock:
                self._idle -= 1
            if caller is None:
                return
            with self._lock:
                reply = self._lanes[caller].replies[0]
            _send(caller, reply)
            self._sent(caller, reply)

    def _sent(self, caller: str, reply: Outgoing) -> None:
        with self._lock:
            lane = self._lanes[caller]
            lane.replies.popleft()
            lane.size -= reply.size
            self._size -= reply.size
            if lane.replies:
                # after the other callers
                self._ready.put(caller)
            else:
                del self._lanes[caller]


def _send(caller: str, reply: Outgoing) -> None:
    try:
        reply.send()
    except BaseException:
        log.exception("a reply to %s could not be sent", caller)
