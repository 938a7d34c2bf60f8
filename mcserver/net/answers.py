"""Answers by (client, request): asked again, the same is answered again and nothing is done twice."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

import msgspec

from mcserver.errors import ServiceError

REMEMBERED_ANSWERS = 4096
REMEMBERED_S = 120.0
REMEMBERED_BYTES = 16 * 1024 * 1024


class Answer(msgspec.Struct, frozen=True):
    """An encoded reply, or an encoded error."""

    ok: bool
    payload: bytes


class _Entry(msgspec.Struct):
    method: str
    since: float
    answer: Answer | None = None


OnAnswer = Callable[[Answer], None]


class AnswerMemory:
    """Bounded by count, by bytes and by age; what is still being worked on is never forgotten.

    Args:
        clock: seconds, never stepping.
        limit, limit_bytes, age_s: bounds of what is remembered.
    """

    def __init__(
        self,
        clock: Callable[[], float],
        *,
        limit: int = REMEMBERED_ANSWERS,
        limit_bytes: int = REMEMBERED_BYTES,
        age_s: float = REMEMBERED_S,
    ) -> None:
        self._clock = clock
        self._limit = limit
        self._limit_bytes = limit_bytes
        self._age_s = age_s
        self._entries: OrderedDict[tuple[str, int], _Entry] = OrderedDict()
        self._waiting: dict[tuple[str, int], list[OnAnswer]] = {}
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._entries)

    def begin(self, client: str, request: int, method: str, on_answer: OnAnswer) -> bool:
        """Whether the request is new and has to be carried out; ``on_answer`` is called at once or with
        `finish`.

        Raises:
            ServiceError: MC506 the number was used for another method.
        """
        self._forget_old()
        key = (client, request)
        entry = self._entries.get(key)
        if entry is None:
            self._entries[key] = _Entry(method, self._clock())
            self._waiting[key] = [on_answer]
            return True
        if entry.method != method:
            raise ServiceError(
                "MC506",
                f"request {request} of {client} was {entry.method}, not {method}",
                "give every new request a new number",
            )
        if entry.answer is not None:
            on_answer(entry.answer)
        else:
            self._waiting[key].append(on_answer)
        return False

    def finish(self, client: str, request: int, answer: Answer) -> None:
        """Answers all that wait for this request, and keeps the answer."""
        key = (client, request)
        entry = self._entries.get(key)
        if entry is None or entry.answer is not None:
            return
        entry.answer = answer
        entry.since = self._clock()
        self._entries.move_to_end(key)
        self._bytes += len(answer.payload)
        for on_answer in self._waiting.pop(key):
            on_answer(answer)
        self._forget_old()

    def _forget_old(self) -> None:
        oldest_allowed = self._clock() - self._age_s
        while self._entries:
            key, entry = next(iter(self._entries.items()))
            if entry.answer is None:
                # under way: it goes to the end, and is looked at again when it comes round
                if len(self._waiting) == len(self._entries):
                    return
                self._entries.move_to_end(key)
                continue
            full = len(self._entries) > self._limit or self._bytes > self._limit_bytes
            if not full and entry.since >= oldest_allowed:
                return
            self._bytes -= len(entry.answer.payload)
            del self._entries[key]
