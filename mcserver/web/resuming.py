"""A page whose link was cut goes on as it is: it is sent what it has missed, and what it sent is done once.

NiceGUI alone sends old states behind new ones, or has the page loaded anew, which costs whoever sits before
it an open dialog, what is ticked, and what was typed. Here a message that was lost is sent again, but of each
element only its newest state. In the other direction each event has a number of its document and the time
at which it was made, is sent again until it is confirmed (static/page.js), and is taken once. Whether it is
too late is judged where it acts (MC604).
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from nicegui import Client, core
from nicegui.logging import log as framework_log
from nicegui.outbox import ClientId, Message, MessageId, MessageType, Outbox, Payload, deleted
from nicegui.slot import Slot

from mcserver.web.delays import DelayGate, event_delay_s
from mcserver.web.page_timer import PageTimer

log = logging.getLogger(__name__)

# of those that no element has, such as what is said once: more than come while a link may be silent
MOST_MESSAGES = 4000
# that show one page, one after the other
MOST_DOCUMENTS = 8


class ResumingOutbox(Outbox):
    """What goes to one browser, kept until the browser has it.

    Args:
        client: the page that it is of, which has a connection or will have one.

    Attributes:
        gate, timer: of its browser.
    """

    def __init__(self, client: Client) -> None:
        super().__init__(client)
        self._taken: dict[str, int] = {}
        self.gate = DelayGate()
        self.timer = PageTimer(lambda code: self.enqueue_message("run_javascript", {"code": code}, client.id))
        self._newest: dict[int, MessageId] = {}
        self._said: deque[tuple[MessageId, Message]] = deque()
        self._is_sending = False
        # none before it is kept
        self._kept_from: MessageId = 0

    def is_news(self, document: str, number: int) -> bool:
        """Note the number of an event of a document that shows the page; False: it has been taken."""
        if number <= self._taken.get(document, 0):
            return False
        if document not in self._taken and len(self._taken) == MOST_DOCUMENTS:
            del self._taken[next(iter(self._taken))]
        self._taken[document] = number
        return True

    def enqueue_message(self, message_type: MessageType, data: Payload, target_id: ClientId) -> None:
        """Send a message; none to a page that is gone, which whoever calls has waited for something on."""
        if not self.client.is_deleted:
            super().enqueue_message(message_type, data, target_id)

    async def _emit(self, message: Message) -> None:
        _, kind, content = message
        if kind == "update":
            self._newest.update(dict.fromkeys(content.keys() - {"_id"}, self.next_message_id))
        elif kind != "load_js_components":
            self._said.append((self.next_message_id, message))
            if len(self._said) > MOST_MESSAGES:
                self._kept_from = self._said.popleft()[0] + 1
        self._is_sending = True
        try:
            await super()._emit(message)
        finally:
            self._is_sending = False

    def try_rewind(self, target_message_id: MessageId) -> None:
        """Send what the browser has not got: all from that message on."""
        # one that is being sent goes by the link that was there as that began
        if target_message_id == self.next_message_id and not self._is_sending:
            return
        if target_message_id < self._kept_from:
            super().try_rewind(target_message_id)
            return
        elements = self.client.elements
        for element, message in self._newest.items():
            if message >= target_message_id:
                self.updates[element] = elements.get(element, deleted)
        missed = [message for number, message in self._said if number >= target_message_id]
        self._said.clear()
        self.messages.extendleft(reversed(missed))
        # a component that was on its way may be lost, too; the browser has each only once
        self._loaded_components.clear()
        self._set_enqueue_event()

    def prune_history(self, next_message_id: MessageId) -> None:
        """Forget what the browser has."""
        super().prune_history(next_message_id)
        self._newest = {each: number for each, number in self._newest.items() if number >= next_message_id}
        while self._said and self._said[0][0] < next_message_id:
            self._said.popleft()


def resume_after_cuts(client: Client) -> None:
    """Have a page that is being built go on after a cut link; before anything is said to its browser."""
    client.outbox.stop()
    client.outbox = ResumingOutbox(client)


def forget_closed_pages() -> None:
    """Have no error logged of a handler that shows something on a page closed while it waited."""
    framework_log.addFilter(_is_of_no_closed_page)


def _is_of_no_closed_page(record: logging.LogRecord) -> bool:
    if record.exc_info is None or not isinstance(record.exc_info[1], RuntimeError):
        return True
    for slot in reversed(Slot.get_stack()):
        # the element of a slot that is gone raises
        with suppress(RuntimeError):
            return not slot.parent.client.is_deleted
    return not Slot.get_stack()


def take_events_once() -> None:
    """Have each event that a browser sends again done once, and confirmed: that its handler has begun."""
    take = core.sio.handlers["/"]["event"]

    def take_once(socket: str, event: dict[str, Any]) -> None:
        with _only_of_a_page():
            outbox = _outbox(event)
            if outbox is not None and "number" in event:
                document, number, sent_s = (event.pop(key) for key in ("document", "number", "sent_s"))
                if not outbox.is_news(document, number):
                    return
                event_delay_s.set(outbox.gate.observe(sent_s))
            take(socket, event)

    def take_clock(_: str, event: dict[str, Any]) -> None:
        with _only_of_a_page():
            outbox = _outbox(event)
            if outbox is not None:
                outbox.gate.observe(event["sent_s"])
                outbox.timer.on_confirmed(event["sign"])

    core.sio.on("event", take_once)
    core.sio.on("clock", take_clock)


@contextmanager
def _only_of_a_page() -> Iterator[None]:
    """Drop what is no event of a page, or of an element that it has no more."""
    try:
        yield
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        log.info("an event of no element of the page: %s: %s", type(error).__name__, error)


def outbox_of(client: Client) -> ResumingOutbox:
    """Return the outbox of a page that `resume_after_cuts` was called for."""
    outbox = client.outbox
    assert isinstance(outbox, ResumingOutbox)
    return outbox


def _outbox(event: dict[str, Any]) -> ResumingOutbox | None:
    """Return the outbox of the page that an event is of; None: there is none any more."""
    client = Client.instances.get(event["client_id"])
    outbox = None if client is None else client.outbox
    return outbox if isinstance(outbox, ResumingOutbox) else None
