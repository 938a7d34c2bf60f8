"""Messages that a network thread handles itself while the loop sleeps; else they go to the loop's inbox."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from mcserver.net.defects import DefectLog
from mcserver.net.inbox import Inbox
from mcserver.net.shared_loop import SharedLoop

log = logging.getLogger(__name__)

T = TypeVar("T")


class Borrower(Generic[T]):
    """Takes one kind of message from Zenoh's threads.

    Args:
        loop: whose turn is borrowed; another loop than a `SharedLoop` lends none.
        inbox: of messages that the loop has to handle, and for those that it is to.
        handle: called with the turn; may give what is left to do once it is given back, which may block.
        ahead: inboxes whose messages came before: while one of them holds any, none is overtaken.
        finish: called with the turn once that is done, with what nobody waits for; where the turn is taken
            by then, whoever has it, or the loop, does it.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        inbox: Inbox[T],
        handle: Callable[[T], Callable[[], None] | None],
        ahead: Sequence[Inbox[Any]],
        finish: Callable[[], None],
    ) -> None:
        # asyncio's debug mode refuses what is scheduled from another thread
        self._loop = loop if isinstance(loop, SharedLoop) and not loop.get_debug() else None
        self._inbox = inbox
        self._handle = handle
        self._ahead = tuple(inbox.waiting for inbox in ahead)
        self._finish = finish
        self._failed = DefectLog(log)

    def push(self, item: T) -> None:
        """Handle a message now if that may be, else queue it; from any thread."""
        loop = self._loop
        if loop is None or any(self._ahead) or not loop.turn.borrow():
            self._inbox.push(item)
            return
        then: Callable[[], None] | None = None
        try:
            # looked at again: nothing is delivered, or comes, while the turn is ours, but by who queues it
            if any(self._ahead):
                self._inbox.push(item)
            else:
                then = self._handle(item)
                if then is None:
                    self._finish()
        except Exception as error:
            self._failed.add(f"a message could not be handled: {error}", error)
        finally:
            loop.turn.give_back()
        if then is None:
            return
        then()
        if loop.turn.borrow():
            try:
                self._finish()
            except Exception as error:
                self._failed.add(f"what a message left to do failed: {error}", error)
            finally:
                loop.turn.give_back()
