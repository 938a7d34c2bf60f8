"""Number and publish events, and keep them for clients that missed some."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from typing import Any

from mcserver.service.reports import Event, EventKind
from mcserver.service.timebase import Timebase

log = logging.getLogger(__name__)

KEPT = 2000


class EventLog:
    """Numbers events from 1 on without gaps.

    Args:
        instance: id of this start of the server.
        time: executor time, and UTC.
        publish: called with each event at once.
    """

    def __init__(self, instance: str, time: Timebase, publish: Callable[[Event], None]) -> None:
        self.newest = 0
        self._instance = instance
        self._time = time
        time.on_step = self._clock_was_set
        self._publish = publish
        self._kept: deque[Event] = deque(maxlen=KEPT)

    def publish(self, kind: EventKind, **values: Any) -> Event:
        """Number, keep and publish an event; ``values`` are the fields of `Event`."""
        # reading the time may publish an event that the clock was set, which has to be numbered first
        epoch, t = self._time.epoch, self._time.now()
        self.newest += 1
        event = Event(seq=self.newest, t=t, wall=epoch + t, instance=self._instance, kind=kind, **values)
        self._kept.append(event)
        self._publish(event)
        return event

    def warn(self, code: str, message: str, *, level: int = logging.WARNING, axis: int | None = None) -> None:
        """Publish a warning, and log it."""
        log.log(level, "%s: %s", code, message)
        self.publish("warning", reason=code, message=message, axis=axis)

    def repeat(self, event: Event) -> None:
        """Publish an event again under its number, by which clients recognize it."""
        self._publish(event)

    def _clock_was_set(self, step_s: float) -> None:
        message = f"the computer's clock was set by {step_s:+.1f} s: times shown before are by the old one"
        self.warn("MC564", message)

    @property
    def oldest(self) -> int:
        """Number of the first event that is still kept."""
        return self._kept[0].seq if self._kept else self.newest + 1

    def since(self, number: int, limit: int) -> list[Event]:
        """Return up to ``limit`` kept events from ``number`` on, oldest first."""
        skip = max(0, number - self.oldest)
        return [event for index, event in enumerate(self._kept) if index >= skip][:limit]
