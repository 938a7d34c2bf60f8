"""Copies of one emergency stop: a stop is sent again until it is confirmed, and on more than one way.

The last copy may arrive when the stop has been confirmed, its cause removed and the latch reset: it is no
stop of its own. Whoever stops puts one random number, `EstopRequest.request`, into all of its copies. A
number is believed for a short time only, and only one that no counter has: in doubt the machine stops.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

# Numbers from here on are random ones; what counts its requests stays below.
LEAST_NUMBER = 1 << 32
# How long the copies of a stop are known as such [s], and of how many stops.
KNOWN_S = 10.0
KNOWN = 256


class StopCopies:
    """The numbers of the stops of the last seconds. For any thread.

    Args:
        clock: monotonic [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        # number: when its first copy came
        self._known: OrderedDict[int, float] = OrderedDict()

    def is_copy(self, number: int | None) -> bool:
        """Return whether a stop of this number came a short while ago, and keep the number."""
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
