"""A disk that stays slow is named: how slow, and since when."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from mcserver.service.disk_watch import KEEPS_UP_S, SLOW_S, DiskWatch
from mcserver.service.event_log import EventLog
from mcserver.service.reports import DiskStatus, Event
from mcserver.service.timebase import Timebase


class SlowJournal:
    """A journal whose work under way has lasted as long as the test says."""

    def __init__(self) -> None:
        self.commit_s = 0.0
        self.sync_s = 0.0


class Watched:
    """A watch on a clock of the test."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.journal = SlowJournal()
        self.events: list[Event] = []
        log = EventLog("one", Timebase(0.0, self._now, self._now), self.events.append)
        loop: Any = asyncio.new_event_loop()
        loop.close()
        self.watch = DiskWatch(loop, self.journal, log, self._now)  # type: ignore[arg-type]

    def look(self, after_s: float, *, commit_s: float = 0.0, sync_s: float = 0.0) -> DiskStatus | None:
        self.now += after_s
        self.journal.commit_s, self.journal.sync_s = commit_s, sync_s
        self.watch.look()
        return self.watch.status

    def _now(self) -> float:
        return self.now


@pytest.mark.parametrize(("commit_s", "sync_s", "what"), [(2.0, 0.0, "said later"), (0.0, 3.0, "power cut")])
def test_a_disk_that_takes_long_is_named_once_with_its_beginning(
    commit_s: float, sync_s: float, what: str
) -> None:
    watched = Watched()
    assert watched.look(0.25, commit_s=0.9 * SLOW_S, sync_s=0.9 * SLOW_S) is None
    status = watched.look(0.25, commit_s=commit_s, sync_s=sync_s)
    assert status is not None
    assert status.since == pytest.approx(watched.now - max(commit_s, sync_s))
    watched.look(0.25, commit_s=commit_s + 0.25, sync_s=sync_s)
    (event,) = watched.events
    assert (event.kind, event.reason) == ("warning", "MC524")
    assert what in event.message


def test_it_keeps_up_again_when_it_has_not_been_slow_for_a_while() -> None:
    watched = Watched()
    watched.look(0.25, sync_s=4.0)
    status = watched.look(1.0)
    assert status is not None
    assert (status.sync_s, status.worst_s) == (0.0, 4.0)
    # slow again in between: one disk that is slow, not two
    watched.look(1.0, sync_s=2.0)
    assert watched.look(KEEPS_UP_S - 1.0) is not None
    assert watched.look(1.5) is None
    assert [event.reason for event in watched.events] == ["MC524", "MC524"]
    assert "keeps up again" in watched.events[-1].message
    assert "4.0 s" in watched.events[-1].message
