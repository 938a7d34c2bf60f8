"""Numbered events: published once, and kept for whoever missed them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from mcserver.service.reports import Event, EventKind

KEPT = 2000


class EventLog:
    """Numbers events without a gap from 1 on.

    Args:
        instance: this start of the server.
        now: executor time [s].
        publish: takes each event at once.
    """

    def __init__(self, instance: str, now: Callable[[], float], publish: Callable[[Event], None]) -> None:
        self.newest = 0
        self._instance = instance
        self._now = now
        self._publish = publish
        self._kept: deque[Event] = deque(maxlen=KEPT)

    def publish(self, kind: EventKind, **values: Any) -> Event:
        """Numbers, keeps and publishes an event; ``values`` are the fields of `Event`."""
        self.newest += 1
        event = Event(seq=self.newest, t=self._now(), instance=self._instance, kind=kind, **values)
        self._kept.append(event)
        self._publish(event)
        return event

    def repeat(self, event: Event) -> None:
        """Publish an event again under its number; who has had it knows that by the number."""
        self._publish(event)

    @property
    def oldest(self) -> int:
        """Number of the first event that is still kept."""
        return self._kept[0].seq if self._kept else self.newest + 1

    def since(self, number: int, limit: int) -> list[Event]:
        """Up to ``limit`` kept events from ``number`` on, oldest first."""
        skip = max(0, number - self.oldest)
        return [event for index, event in enumerate(self._kept) if index >= skip][:limit]
