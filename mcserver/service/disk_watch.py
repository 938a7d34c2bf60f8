"""Warn when the disk under the journal is slow.

Then progress of programs is reported later, or a power cut would lose more of it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from mcserver.service.event_log import EventLog
from mcserver.service.journal import Journal
from mcserver.service.reports import DiskStatus

LOOK_S = 0.25
# A commit takes milliseconds, a sync of a disk that is not busy some tens [s].
SLOW_S = 1.0
# A disk that was slow is recovered once it has not been slow for this time [s].
KEEPS_UP_S = 10.0


class DiskWatch:
    """Checks the journal's disk periodically.

    Args:
        loop: in which it runs. clock: Unix time [s].
        events: get a warning MC524 when the disk becomes slow, and another when it has recovered.

    Attributes:
        status: how slow the disk is; None: not slow.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        journal: Journal,
        events: EventLog,
        clock: Callable[[], float],
    ) -> None:
        self.status: DiskStatus | None = None
        self._loop = loop
        self._journal = journal
        self._events = events
        self._clock = clock
        self._slow_at = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Check periodically, until `stop`."""
        self.look()
        self._timer = self._loop.call_later(LOOK_S, self.start)

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def look(self) -> None:
        """Check once."""
        now, before = self._clock(), self.status
        commit_s, sync_s = self._journal.commit_s, self._journal.sync_s
        slowest = max(commit_s, sync_s)
        if slowest >= SLOW_S:
            self._slow_at = now
        if before is None:
            if slowest >= SLOW_S:
                self.status = DiskStatus(now - slowest, commit_s, sync_s, slowest)
                what = (
                    "what programs have done is said later"
                    if commit_s >= SLOW_S
                    else "a power cut takes more"
                )
                self._events.warn("MC524", f"the disk of the journal is slow, {slowest:.1f} s so far: {what}")
        elif now - self._slow_at < KEEPS_UP_S:
            self.status = DiskStatus(before.since, commit_s, sync_s, max(before.worst_s, slowest))
        else:
            self.status = None
            slow = f"it was slow for {self._slow_at - before.since:.0f} s, took up to {before.worst_s:.1f} s"
            self._events.warn("MC524", f"the disk of the journal keeps up again; {slow}")
