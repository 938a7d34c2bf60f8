"""Events in order and without gap: what the network lost is asked for again by its number."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TypeVar

from mcclient.errors import MotionError
from mcclient.feed import Feed, Queue
from mcclient.transport import Arrived, Link
from mcclient.types import Event, EventsReply
from mcclient.wire import decode

log = logging.getLogger(__name__)

T = TypeVar("T")
EVENTS_LIMIT = 20_000
WAITING_LIMIT = 5000
FetchPage = Callable[[int], Awaitable[EventsReply]]


class EventOrder:
    """Puts events in order; a state machine without I/O.

    Args:
        from_start: begin with the oldest event that the server still has; else with the first that arrives.
    """

    def __init__(self, *, from_start: bool = False) -> None:
        self.missed = 0
        self._instance: str | None = None
        self._former: str | None = None
        self._next: int | None = 0 if from_start else None
        self._waiting: dict[int, Event] = {}

    @property
    def gap(self) -> int | None:
        """Number from which events have to be asked for; None: nothing is known to be missing."""
        if self._next is None or not self._waiting:
            return None
        return self._next

    def take(self, event: Event) -> list[Event]:
        """Return what may be passed on now that this event has arrived."""
        if event.instance == self._former:
            return []
        if event.instance != self._instance:
            if self._instance is not None:
                # a new start of the server: it counts from its own beginning
                self._next = 0
                self._waiting.clear()
            self._former, self._instance = self._instance, event.instance
        if self._next is None:
            self._next = event.seq
        if event.seq >= self._next and len(self._waiting) < WAITING_LIMIT:
            self._waiting[event.seq] = event
        return self._in_order()

    def fill(self, page: EventsReply) -> list[Event]:
        """Return what may be passed on now that the server has repeated its events."""
        if self._instance is None:
            self._instance = page.instance
        if page.instance != self._instance:
            return []
        if self._next is None:
            self._next = page.oldest
        if page.oldest > self._next:
            # the server no longer has them; the first start of a count is no loss
            self.missed += page.oldest - self._next if self._next > 0 else 0
            self._next = page.oldest
        for event in page.events:
            if event.seq >= self._next:
                self._waiting[event.seq] = event
        return self._in_order()

    def give_up(self) -> list[Event]:
        """The gap cannot be closed: goes on behind it."""
        if self._waiting and self._next is not None:
            first = min(self._waiting)
            self.missed += first - self._next
            self._next = first
        return self._in_order()

    def _in_order(self) -> list[Event]:
        ready: list[Event] = []
        while self._next is not None and self._next in self._waiting:
            ready.append(self._waiting.pop(self._next))
            self._next += 1
        return ready


class EventReader:
    """Takes samples of the subscription, passes events on in order, and asks for what is missing.

    Args:
        pass_on: called with each event, in order. missed: called with a number of events that are lost for
            good.
        fetch: asks the server for events from a number on.
        from_start: begin with the oldest that the server still has.
    """

    def __init__(
        self,
        pass_on: Callable[[Event], None],
        missed: Callable[[int], None],
        fetch: FetchPage,
        *,
        from_start: bool,
    ) -> None:
        self._pass_each_on = pass_on
        self._missed = missed
        self._fetch = fetch
        self._order = EventOrder(from_start=from_start)
        self._fetching: asyncio.Task[None] | None = None
        if from_start:
            self._start_fetching(0)

    def on_sample(self, arrived: Arrived) -> None:
        try:
            event = decode(Event, arrived.payload)
        except MotionError as error:
            log.warning("an event was not understood: %s", error)
            return
        self._pass_on(self._order.take(event))
        if self._order.gap is not None and self._fetching is None:
            self._start_fetching(self._order.gap)

    def stop(self) -> None:
        if self._fetching is not None:
            self._fetching.cancel()

    def _pass_on(self, events: list[Event]) -> None:
        for event in events:
            self._pass_each_on(event)

    def _start_fetching(self, since: int) -> None:
        self._fetching = asyncio.get_running_loop().create_task(self._close_gap(since))

    async def _close_gap(self, since: int) -> None:
        try:
            wanted: int | None = since
            while wanted is not None:
                page = await self._fetch(wanted)
                self._pass_on(self._order.fill(page))
                last = page.events[-1].seq if page.events else page.newest
                if last < page.newest:
                    wanted = last + 1
                    continue
                wanted = self._order.gap
                if wanted is not None:
                    # the server has been asked and did not close it
                    self._pass_on(self._order.give_up())
                    wanted = self._order.gap
        except MotionError as error:
            log.debug("events could not be asked for again: %s", error)
            self._pass_on(self._order.give_up())
        finally:
            self._fetching = None
            self._missed(self._order.missed)
            self._order.missed = 0


def open_events(
    link: Link, key: str, fetch: FetchPage, take: Callable[[Queue[T], Event], None], *, history: bool = False
) -> Feed[T]:
    """Return a feed of events in order, or of what they say.

    Args:
        take: puts what an event says into the queue. history: those that the server still has come first.
    """
    queue: Queue[T] = Queue(EVENTS_LIMIT)

    def missed(count: int) -> None:
        queue.missed += count

    reader = EventReader(lambda event: take(queue, event), missed, fetch, from_start=history)
    subscription = link.subscribe_recovering(key, reader.on_sample, limit=EVENTS_LIMIT)

    def release() -> None:
        subscription.close()
        reader.stop()

    return Feed(queue, release)
