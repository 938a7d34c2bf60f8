"""Connections of a page or gateway are bounded in number and time; one more always gets in."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator

import pytest
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import Response
from starlette.types import Message, Receive, Scope, Send

from mcserver.doors.limits import BodyLimit, Connection, Door, DoorLimits, LimitedRequests
from tests.clock import Clock

LIMIT_S = 10.0


class Visitors:
    """A door, and both ends of the connections that came to it."""

    def __init__(self, limits: DoorLimits, files: int = 100_000) -> None:
        self.clock = Clock(0.0)
        self.door = Door(socket.create_server(("127.0.0.1", 0)), limits, self.clock, files)
        self.theirs: list[socket.socket] = []
        self.ours: list[Connection] = []

    def come(self, holder: str = "", *, at_work: bool = False) -> int:
        """One more connection; with a holder it has made a request, which may still be under way."""
        self.theirs.append(socket.create_connection(self.door.getsockname(), timeout=LIMIT_S))
        taken, _ = self.door.accept()
        assert isinstance(taken, Connection)
        self.ours.append(taken)
        if holder or at_work:
            self.door.begin(taken.address, holder)
            if not at_work:
                self.door.finish(taken.address)
        return len(self.ours) - 1

    def is_open(self, number: int) -> bool:
        self.theirs[number].setblocking(False)
        try:
            return self.theirs[number].recv(1) != b""
        except BlockingIOError:
            return True

    def open(self) -> list[int]:
        return [number for number in range(len(self.theirs)) if self.is_open(number)]


@pytest.fixture
def visitors() -> Iterator[list[Visitors]]:
    made: list[Visitors] = []
    yield made
    for each in made:
        for end in (each.door, *each.theirs, *each.ours):
            end.close()


def test_a_new_connection_takes_the_place_of_the_oldest_without_a_secret(visitors: list[Visitors]) -> None:
    here = Visitors(DoorLimits(connections=4))
    visitors.append(here)
    known = here.come("alice")
    half_open = [here.come() for _ in range(3)]
    one_more = here.come()
    assert here.open() == [known, *half_open[1:], one_more]


def test_half_open_connections_keep_nobody_out_however_many(visitors: list[Visitors]) -> None:
    here = Visitors(DoorLimits(connections=8))
    visitors.append(here)
    working = here.come("alice", at_work=True)
    for _ in range(100):
        here.come()
    one_more = here.come()
    assert here.is_open(working)
    assert here.is_open(one_more)
    assert len(here.open()) == 8


def test_half_of_the_files_of_the_process_are_left_for_its_work(visitors: list[Visitors]) -> None:
    here = Visitors(DoorLimits(connections=1000), files=20)
    visitors.append(here)
    for _ in range(30):
        here.come()
    assert len(here.open()) == 10


def test_where_all_are_at_work_for_who_may_the_new_one_has_to_go(visitors: list[Visitors]) -> None:
    here = Visitors(DoorLimits(connections=2))
    visitors.append(here)
    working = [here.come(name, at_work=True) for name in ("alice", "bob")]
    here.come()
    assert here.open() == working


def test_one_token_takes_no_more_than_its_connections(visitors: list[Visitors]) -> None:
    here = Visitors(DoorLimits(connections=100, holder_connections=2))
    visitors.append(here)
    other = here.come("bob")
    first, second, third = (here.come("alice") for _ in range(3))
    assert here.open() == [other, second, third]
    assert not here.is_open(first)


def test_a_connection_without_a_request_ends_and_one_at_work_does_not(visitors: list[Visitors]) -> None:
    here = Visitors(DoorLimits(quiet_s=10.0))
    visitors.append(here)
    half_open, working, answered = here.come(), here.come("alice", at_work=True), here.come("bob")
    here.clock.now = 9.0
    here.door.begin(here.ours[answered].address, "bob")
    here.door.finish(here.ours[answered].address)
    here.clock.now = 11.0
    here.door.end_quiet()
    assert here.open() == [working, answered]
    assert half_open not in here.open()


def test_a_closed_connection_gives_its_place_back(visitors: list[Visitors]) -> None:
    here = Visitors(DoorLimits(connections=2))
    visitors.append(here)
    for _ in range(20):
        gone = here.come("alice")
        here.ours[gone].close()
    kept = [here.come(), here.come()]
    assert here.open() == kept


# ------------------------------------------------------------ requests


class Exchange:
    """One request to an application that reads all of its body."""

    def __init__(
        self, door: Door, path: str, pieces: list[Message], headers: list[tuple[bytes, bytes]]
    ) -> None:
        self.read = 0
        self.sent: list[Message] = []
        self._pieces = pieces
        self._app = LimitedRequests(self._answer, door, lambda _: "")
        self._scope: Scope = {
            "type": "http",
            "path": path,
            "headers": headers,
            "client": ("127.0.0.1", 1),
        }

    async def run(self) -> int:
        async def receive() -> Message:
            if not self._pieces:
                await asyncio.Event().wait()
            return self._pieces.pop(0)

        async def send(message: Message) -> None:
            self.sent.append(message)

        await self._app(self._scope, receive, send)
        status: int = self.sent[0]["status"] if self.sent else 0
        return status

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        HTTPConnection(scope)
        more = True
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                raise ClientDisconnect
            self.read += len(message["body"])
            more = message["more_body"]
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})


def pieces(count: int, size: int) -> list[Message]:
    piece = {"type": "http.request", "body": size * b"x"}
    return [{**piece, "more_body": number < count - 1} for number in range(count)]


LIMITS = DoorLimits(
    body=BodyLimit(1000, 60.0), bodies=(("/login", BodyLimit(100, 60.0)), ("/slow", BodyLimit(9, 0)))
)


@pytest.mark.parametrize(
    ("path", "count", "status"),
    [("/any", 10, 200), ("/any", 11, 413), ("/login", 1, 200), ("/login", 2, 413)],
)
async def test_a_body_is_bounded_while_it_is_read(
    visitors: list[Visitors], path: str, count: int, status: int
) -> None:
    here = Visitors(LIMITS)
    visitors.append(here)
    exchange = Exchange(here.door, path, pieces(count, 100), [])
    assert await exchange.run() == status
    assert exchange.read <= LIMITS.body_of(path).size


async def test_a_body_that_says_that_it_is_too_large_is_not_read(visitors: list[Visitors]) -> None:
    here = Visitors(LIMITS)
    visitors.append(here)
    exchange = Exchange(here.door, "/login", pieces(100, 100), [(b"content-length", b"419430400")])
    assert await exchange.run() == 413
    assert exchange.read == 0


async def test_a_body_that_does_not_come_ends_the_request(visitors: list[Visitors]) -> None:
    here = Visitors(LIMITS)
    visitors.append(here)
    assert await Exchange(here.door, "/slow", [], []).run() == 408


@pytest.mark.parametrize("count", [0, 1])
async def test_a_client_that_goes_within_its_body_is_answered_by_nobody(
    visitors: list[Visitors], count: int
) -> None:
    here = Visitors(LIMITS)
    visitors.append(here)
    begun: list[Message] = [{**each, "more_body": True} for each in pieces(count, 100)]
    exchange = Exchange(here.door, "/any", [*begun, {"type": "http.disconnect"}], [])
    await exchange.run()
    assert (exchange.read, exchange.sent) == (100 * count, [])


async def test_a_request_that_an_application_leaves_without_an_answer_is_refused(
    visitors: list[Visitors],
) -> None:
    here = Visitors(LIMITS)
    visitors.append(here)
    exchange = Exchange(here.door, "/any", [], [])

    async def leave(*_: object) -> None:
        raise RuntimeError("No response returned.")

    exchange._app._app = leave
    assert await exchange.run() == 400


@pytest.mark.parametrize(("path", "count", "status"), [("/login", 2, 413), ("/slow", 0, 408)])
async def test_a_limit_is_said_through_a_framework_that_wraps_what_ends_it(
    visitors: list[Visitors], path: str, count: int, status: int
) -> None:
    here = Visitors(LIMITS)
    visitors.append(here)
    exchange = Exchange(here.door, path, pieces(count, 100), [])

    async def passed(request: Request, call_next: RequestResponseEndpoint) -> Response:
        return await call_next(request)

    exchange._app._app = BaseHTTPMiddleware(BaseHTTPMiddleware(exchange._answer, passed), passed)
    assert await exchange.run() == status
