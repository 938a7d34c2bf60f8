"""An event loop that lends its turn: while it sleeps, a network thread may do what the loop would do.

A call that comes to an idle server costs two handoffs between threads, each as long as all the rest of the
call. Most calls need neither: while the loop waits for something to happen nothing of the service can change,
so whoever holds the loop's turn may work on it as the loop itself does. The turn is a lock that the loop
gives back only while it sleeps in its selector.
"""

from __future__ import annotations

import asyncio
import math
import selectors
import threading
import time
from collections.abc import Mapping
from typing import Any

Ready = list[tuple[selectors.SelectorKey, int]]

# how late a loop may notice what a borrower has left it, without being woken for it [s]; the shortest timer
# of the service is twice as long
NOTICED_WITHIN_S = 0.01
# how long after its turn was borrowed a loop sleeps no longer than that [s]: calls seldom come alone, and
# each would wake it, which then competes with the call for the interpreter
ALERT_S = 1.0


class Turn:
    """The right to work on what belongs to the loop.

    The loop holds it but for its sleep; others get it for a moment, or not at all. Nobody waits for it but
    the loop, which goes before everybody else.

    Attributes:
        wanted: the loop waits for it. lent: somebody has had it since the loop last cleared this.
    """

    def __init__(self) -> None:
        self.wanted = False
        self.lent = False
        self._lock = threading.Lock()
        # the loop's, until it sleeps for the first time
        self._lock.acquire()

    def borrow(self) -> bool:
        """Take the turn if the loop sleeps; from a thread that gives it back at once."""
        if self.wanted or not self._lock.acquire(blocking=False):
            return False
        self.lent = True
        return True

    def give_back(self) -> None:
        """End what `borrow` or the loop began."""
        self._lock.release()

    def take_back(self) -> None:
        """Wait for the turn, before all who would borrow it: for the loop."""
        self.wanted = True
        self._lock.acquire()
        self.wanted = False


class _LendingSelector(selectors.BaseSelector):
    """A selector that gives the loop's turn back while it waits.

    Args:
        inner: does the work. turn: of the loop.

    Attributes:
        sleeps_until: when the present sleep ends by itself [s of `time.monotonic`].
    """

    def __init__(self, inner: selectors.BaseSelector, turn: Turn) -> None:
        self.sleeps_until = 0.0
        self._alert_until = 0.0
        self._inner = inner
        self._turn = turn

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._inner.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._inner.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._inner.modify(fileobj, events, data)

    def select(self, timeout: float | None = None) -> Ready:
        if timeout is not None and timeout <= 0.0:
            # the loop has work: it only looks what else there is
            return self._inner.select(timeout)
        now = time.monotonic()
        if self._turn.lent:
            self._turn.lent = False
            self._alert_until = now + ALERT_S
        if now < self._alert_until:
            timeout = NOTICED_WITHIN_S if timeout is None else min(timeout, NOTICED_WITHIN_S)
        self.sleeps_until = math.inf if timeout is None else now + timeout
        self._turn.give_back()
        try:
            return self._inner.select(timeout)
        finally:
            self._turn.take_back()

    def get_key(self, fileobj: Any) -> selectors.SelectorKey:
        return self._inner.get_key(fileobj)

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._inner.get_map()

    def close(self) -> None:
        self._inner.close()


class SharedLoop(asyncio.SelectorEventLoop):
    """asyncio's loop, with a turn that others may borrow.

    Attributes:
        turn: see `Turn`. What a borrower schedules with ``call_later`` is noticed by the loop after `notice`.
    """

    def __init__(self) -> None:
        self.turn = Turn()
        self._lending = _LendingSelector(selectors.DefaultSelector(), self.turn)
        super().__init__(self._lending)

    def notice(self) -> None:
        """See that the loop notices new timers within `NOTICED_WITHIN_S`; from any thread."""
        if self._lending.sleeps_until <= time.monotonic() + NOTICED_WITHIN_S:
            # it wakes by itself, which costs the caller nothing
            return
        try:
            self.call_soon_threadsafe(_nothing)
        except RuntimeError:
            # it is closed: nothing is due any more
            return


def _nothing() -> None:
    """What a loop that is only woken does."""
