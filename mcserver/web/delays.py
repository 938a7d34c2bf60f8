"""How late a browser's messages are: what was held up on the way must not move anything when it comes.

The browser sends its own clock with each sign of life that it confirms, and with whatever is pressed
(static/page.js, resuming.py).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextvars import ContextVar

from mcclient import MotionError

from mcserver.web.translation import mark

# for so long at least the quickest message is the measure of the others [s]: longer than a link may be silent
# before it is given up, shorter than it takes two clocks to drift apart
MEASURED_S = 60.0
# what was pressed may be so late [s]: then the page says that nothing comes, too (SILENT_MS in page.js)
MAX_ORDER_DELAY_S = 3.0
# of the event that a handler is called for, and of the tasks that it begins [s]: others may have come since
event_delay_s: ContextVar[float] = ContextVar("event_delay_s", default=0.0)


def late_press(delay_s: float) -> MotionError:
    """Return that something was pressed too long ago to be done (MC604)."""
    return MotionError(
        "MC604",
        mark("This was pressed {seconds:.1f} s ago: the link was held up", seconds=delay_s),
        mark("look at the machine, then press it again"),
    )


class DelayGate:
    """Judges how late the messages of one browser are, by its own clock.

    The clocks' offset is unknown: the least difference seen of late stands for a message without delay.

    Args:
        clock: seconds, never stepping.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._before = self._least = float("inf")
        self._since: float | None = None

    def observe(self, sent_s: float) -> float:
        """Take the time at which a message was sent; return how late it is against the quickest one [s]."""
        now = self._clock()
        offset = now - sent_s
        if self._since is None or now - self._since > MEASURED_S:
            self._before, self._least, self._since = self._least, offset, now
        self._least = min(self._least, offset)
        return offset - min(self._before, self._least)
