"""Remote calls: request numbers, and repetition inside a deadline.

An empty answer looks the same whether nobody is there, the server restarts, the caller has no right or the
reply was lost. So the same request is sent again with the same number until the deadline; the server gives
the same answer again and does nothing twice (docs/wire/calls.md).
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Iterator
from typing import Any, TypeVar

from mcclient.errors import MotionError, NoAnswerInTime, NobodyAnswers, RequestRefused, closed_client
from mcclient.keys import Keys
from mcclient.presence import Presence
from mcclient.transport import Link, Reply
from mcclient.types import ErrorReply
from mcclient.wire import decode, encode

T = TypeVar("T")

DEADLINE_S = 5.0
ATTEMPT_S = 2.0
FIRST_PAUSE_S = 0.02
LONGEST_PAUSE_S = 0.25
# the server is on its way out, its next start answers
PASSING = frozenset({"MC515"})


class Caller:
    """Calls methods of one machine.

    Args:
        link: the session.
        keys: of the machine.
        presence: whether the server is there.
        numbers: of requests, where the client calls in other ways beside; None: its own.
    """

    def __init__(
        self, link: Link, keys: Keys, presence: Presence, *, numbers: Iterator[int] | None = None
    ) -> None:
        self._link = link
        self._keys = keys
        self._presence = presence
        self._numbers = itertools.count(1) if numbers is None else numbers

    async def ask(self, kind: type[T], method: str, fields: dict[str, Any], deadline_s: float) -> T:
        """Return the reply as one of `mcclient.types`; what may take long is asked for once. Raises as
        `call`.
        """
        attempt_s = ATTEMPT_S if deadline_s <= DEADLINE_S else deadline_s
        return decode(kind, await self.call(method, fields, deadline_s=deadline_s, attempt_s=attempt_s))

    async def call(
        self,
        method: str,
        fields: dict[str, Any] | None = None,
        *,
        deadline_s: float = DEADLINE_S,
        attempt_s: float = ATTEMPT_S,
        patient: bool = False,
    ) -> bytes:
        """Return the reply's payload.

        Args:
            deadline_s: how long to try.
            attempt_s: how long one query waits before it is sent again.
            patient: the deadline starts anew as long as the server is there: for what waits for motion.

        Raises:
            NobodyAnswers: MC530 nobody is there, MC532 (`NoAnswerInTime`) somebody is, and does not answer.
            RequestRefused: the server's error reply.
        """
        payload = encode({"request": next(self._numbers), **(fields or {})})
        key = self._keys.rpc(method)
        clock = asyncio.get_running_loop().time
        deadline = clock() + deadline_s
        pause = FIRST_PAUSE_S
        while True:
            if self._link.closed:
                raise closed_client()
            remaining = deadline - clock()
            if remaining <= 0.0:
                raise self._no_answer(method, deadline_s)
            sent_at = clock()
            replies = await self._link.query(key, payload, timeout_s=min(attempt_s, remaining), one=True)
            if replies:
                error = _error_of(replies[0])
                if error is None:
                    return replies[0].payload
                if error.code not in PASSING:
                    raise error
            if patient and self._presence.online:
                deadline = clock() + deadline_s
            if replies or clock() - sent_at < min(attempt_s, remaining) / 2:
                # answered empty at once: wait for the server to come, or a little
                await self._presence.wait_for_change(min(pause, max(0.0, deadline - clock())))
                pause = min(2 * pause, LONGEST_PAUSE_S)

    def _no_answer(self, method: str, deadline_s: float) -> MotionError:
        machine = self._keys.machine
        if self._presence.online:
            return NoAnswerInTime(
                "MC532",
                f"{machine} has not answered {method} within {deadline_s:g} s",
                "the server may be busy, or the access rules forbid it; see its log",
                details={"method": method},
            )
        return NobodyAnswers(
            "MC530",
            f"{machine} is no longer there: {method} got no answer within {deadline_s:g} s",
            "is the server running? mcctl list shows who answers",
            details={"method": method},
        )


def _error_of(reply: Reply) -> RequestRefused | None:
    if reply.ok:
        return None
    error = decode(ErrorReply, reply.payload)
    return RequestRefused(
        error.code, error.message, error.hint, details=error.details, diagnostics=error.diagnostics
    )
