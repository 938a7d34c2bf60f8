"""What is compared never steps and belongs to one start; what is shown is UTC, taken when it happened."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.service.event_log import EventLog
from mcserver.service.reports import Event
from mcserver.service.timebase import Timebase
from tests.service.conftest import Bench

NOON = 1_773_489_600.0


class Clocks:
    """A computer's clocks, an hour of which may be set."""

    def __init__(self) -> None:
        self.unix = NOON
        self.monotonic = 500.0

    def pass_(self, seconds: float) -> None:
        self.unix += seconds
        self.monotonic += seconds

    def timebase(self) -> Timebase:
        return Timebase(NOON, lambda: self.unix, lambda: self.monotonic)


@pytest.fixture
def clocks() -> Clocks:
    return Clocks()


def log_of(clocks: Clocks) -> tuple[EventLog, list[Event]]:
    events: list[Event] = []
    return EventLog("one", clocks.timebase(), events.append), events


def test_an_event_carries_the_time_of_its_start_and_utc(clocks: Clocks) -> None:
    log, events = log_of(clocks)
    clocks.pass_(2.5)
    log.publish("reset")
    assert [(event.t, event.wall, event.instance) for event in events] == [(2.5, NOON + 2.5, "one")]


def test_a_clock_that_is_set_moves_no_executor_time_and_is_said_once(clocks: Clocks) -> None:
    log, events = log_of(clocks)
    clocks.pass_(10.0)
    log.publish("reset")
    clocks.unix += 3600.0
    clocks.pass_(1.0)
    log.publish("reset")
    log.publish("reset")
    assert [event.seq for event in events] == [1, 2, 3, 4]
    assert [event.reason for event in events] == ["", "MC564", "", ""]
    assert "+3600.0 s" in events[1].message
    assert [event.t for event in events] == [10.0, 11.0, 11.0, 11.0]
    assert [event.wall - NOON for event in events] == [10.0, 3611.0, 3611.0, 3611.0]


def test_a_clock_that_is_slowly_corrected_is_no_step(clocks: Clocks) -> None:
    log, events = log_of(clocks)
    for _ in range(100):
        clocks.pass_(10.0)
        clocks.unix += 0.05
        log.publish("reset")
    assert {event.kind for event in events} == {"reset"}
    assert events[-1].wall == pytest.approx(NOON + 1005.0)


async def test_events_of_two_starts_tell_their_starts_apart(tmp_path: Path) -> None:
    found: list[Event] = []
    for instance in ("one", "two"):
        bench = Bench(tmp_path / "journal.db", instance)
        bench.service.start()
        await bench.service.stop()
        found += bench.events
    assert {event.instance for event in found} == {"one", "two"}
    assert all(event.wall > NOON for event in found)
    walls = [event.wall for event in found]
    assert walls == sorted(walls)
