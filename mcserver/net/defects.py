"""Count errors with messages, and log a few of them."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

LOG_PERIOD_S = 5.0


class DefectLog:
    """Counts errors of one kind, and logs at most one per `LOG_PERIOD_S`, with the count omitted since.

    Args:
        clock: monotonic [s].

    Attributes:
        count: of all errors so far.
    """

    def __init__(self, log: logging.Logger, clock: Callable[[], float] = time.monotonic) -> None:
        self.count = 0
        self._log = log
        self._clock = clock
        self._logged_at = -LOG_PERIOD_S
        self._logged_count = 0

    def add(self, message: str, error: BaseException | None = None) -> bool:
        """Count an error; return whether it was logged. With ``error`` its traceback is logged too."""
        self.count += 1
        now = self._clock()
        if now - self._logged_at < LOG_PERIOD_S:
            return False
        omitted = self.count - self._logged_count - 1
        self._logged_at, self._logged_count = now, self.count
        suffix = f" (and {omitted} more since the last report)" if omitted else ""
        self._log.warning("%s%s", message, suffix, exc_info=error)
        return True
