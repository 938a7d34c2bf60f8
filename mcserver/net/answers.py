"""Remember answers by (client, request): a repeated request is answered again, but not executed again."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

import msgspec

from mcserver.errors import ServiceError

REMEMBERED_ANSWERS = 1024
REMEMBERED_S = 120.0
REMEMBERED_BYTES = 2 * 1024 * 1024
# most clients whose answers are remembered
REMEMBERED_CLIENTS = 1024


class Answer(msgspec.Struct, frozen=True):
    """An encoded reply, or an encoded error."""

    ok: bool
    payload: bytes


OnAnswer = Callable[[Answer], None]


class _Entry(msgspec.Struct):
    method: str
    since: float
    answer: Answer | None = None
    waiting: list[OnAnswer] = []


class _Client:
    """One client's requests in progress, and its answers by age."""

    def __init__(self) -> None:
        self.entries: dict[int, _Entry] = {}
        self.answered: OrderedDict[int, None] = OrderedDict()
        self.size = 0

    def forget_oldest(self) -> None:
        number, _ = self.answered.popitem(last=False)
        answer = self.entries.pop(number).answer
        self.size -= len(answer.payload) if answer is not None else 0


class AnswerMemory:
    """Remembers answers, bounded per client in count, bytes and age; requests in progress are always kept.

    No client's requests displace another client's answers: if too many clients are remembered, another one is
    refused until an old one's answers have expired.

    Args:
        clock: monotonic [s].
        limit, limit_bytes, age_s: bounds of one client's answers.
        clients: most clients remembered.
    """

    def __init__(
        self,
        clock: Callable[[], float],
        *,
        limit: int = REMEMBERED_ANSWERS,
        limit_bytes: int = REMEMBERED_BYTES,
        age_s: float = REMEMBERED_S,
        clients: int = REMEMBERED_CLIENTS,
    ) -> None:
        self._clock = clock
        self._limit = limit
        self._limit_bytes = limit_bytes
        self._age_s = age_s
        self._limit_clients = clients
        # ordered by last answer, oldest first
        self._clients: OrderedDict[str, _Client] = OrderedDict()

    def __len__(self) -> int:
        return sum(len(client.entries) for client in self._clients.values())

    def begin(self, client: str, request: int, method: str, on_answer: OnAnswer) -> bool:
        """Return whether the request is new and has to be executed; ``on_answer`` is called at once, or by
        `finish`.

        Raises:
            ServiceError: MC506 the number was used for another method, MC508 too many clients.
        """
        known = self._client(client)
        if request in known.entries:
            # do not answer from expired memory
            self._forget_old(known)
        entry = known.entries.get(request)
        if entry is None:
            known.entries[request] = _Entry(method, self._clock(), waiting=[on_answer])
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
            entry.waiting.append(on_answer)
        return False

    def finish(self, client: str, request: int, answer: Answer) -> None:
        """Answer everyone who waits for this request, and remember the answer."""
        known = self._clients.get(client)
        entry = known.entries.get(request) if known is not None else None
        if known is None or entry is None or entry.answer is not None:
            return
        entry.answer = answer
        entry.since = self._clock()
        known.answered[request] = None
        known.size += len(answer.payload)
        self._clients.move_to_end(client)
        waiting, entry.waiting = entry.waiting, []
        for on_answer in waiting:
            on_answer(answer)
        self._forget_old(known)

    def _client(self, name: str) -> _Client:
        known = self._clients.get(name)
        if known is not None:
            return known
        if len(self._clients) >= self._limit_clients:
            self._forget_clients()
        if len(self._clients) >= self._limit_clients:
            raise ServiceError(
                "MC508",
                f"{self._limit_clients} clients have changed something within {self._age_s:g} s",
                "use one client id for all calls of a client, or try again later",
            )
        known = self._clients[name] = _Client()
        return known

    def _forget_clients(self) -> None:
        """Remove clients without remembered answers, the oldest first."""
        for name in list(self._clients):
            known = self._clients[name]
            self._forget_old(known)
            if known.answered:
                return
            if not known.entries:
                del self._clients[name]

    def _forget_old(self, known: _Client) -> None:
        oldest_allowed = self._clock() - self._age_s
        while known.answered:
            oldest = known.entries[next(iter(known.answered))]
            full = len(known.answered) > self._limit or known.size > self._limit_bytes
            if not full and oldest.since >= oldest_allowed:
                return
            known.forget_oldest()
