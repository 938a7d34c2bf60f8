"""Recognize copies of one emergency stop, which is sent repeatedly, and on several routes, until confirmed.

The last copy may arrive when the stop has been confirmed, its cause removed and the latch reset: it is not a
new stop. The sender puts one random number, `EstopRequest.request`, into all copies. A number marks a
copy for a short time only, and only in the range above all counters: in doubt the machine stops.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

# Random numbers begin here; counters of requests stay below.
LEAST_NUMBER = 1 << 32
# Time for which copies of a stop are recognized [s], and most stops remembered.
KNOWN_S = 10.0
KNOWN = 256


class StopCopies:
    """Numbers of the latest stops. Thread-safe.

    Args:
        clock: monotonic [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        # number → time of its first copy
        self._known: OrderedDict[int, float] = OrderedDict()

    def is_copy(self, number: int | None) -> bool:
        """Return whether a stop with this number came recently, and remember the number."""
        if number is None or number < LEAST_NUMBER:
            return False
        now = self._clock()
        with self._lock:
            while self._known and (
                len(self._known) >= KNOWN or now - next(iter(self._known.values())) > KNOWN_S
            ):
                self._known.popitem(last=False)
            known = number in self._known
            self._known.setdefault(number, now)
            return known
