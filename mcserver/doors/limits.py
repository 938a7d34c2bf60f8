"""Connections of a page or gateway: bounded in number and time, so that one more always gets in.

A connection counts from its accept, before TLS and before its first byte. Where all places are taken, the
oldest connection that has not shown a secret gives its place up: half-open connections, however many, keep
nobody out who has a token, and no emergency stop.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import time
from collections import Counter
from collections.abc import Callable

import msgspec
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

log = logging.getLogger(__name__)

# as Starlette says it of an application that ends without an answer
UNANSWERED = ("No response returned.",)
Address = tuple[str, int]


class BodyLimit(msgspec.Struct, frozen=True):
    """What a request may bring [bytes], and how long it may take for that [s]."""

    size: int
    time_s: float


class DoorLimits(msgspec.Struct, frozen=True):
    """What connections may take.

    Attributes:
        connections: in all. address_connections: of one address. holder_connections: with one token or login.
        quiet_s: without a request under way: from the accept to the end of the request's head, and between
            requests. send_s: for a piece of an answer to be taken.
        body: of a request. bodies: the same by the beginning of the path.
    """

    connections: int = 1024
    address_connections: int = 512
    holder_connections: int = 64
    quiet_s: float = 10.0
    send_s: float = 30.0
    body: BodyLimit = BodyLimit(1024 * 1024, 30.0)
    bodies: tuple[tuple[str, BodyLimit], ...] = ()

    def body_of(self, path: str) -> BodyLimit:
        """Return the limit of a request to this path."""
        return next((limit for start, limit in self.bodies if path.startswith(start)), self.body)


class Connection(socket.socket):
    """An accepted connection, as the door counts it.

    Attributes:
        address: of its other end. holder: whose secret it has shown; empty: nobody's.
        under_way: requests. quiet_since: when the last one ended [s of the door's clock].
    """

    address: Address
    holder: str
    under_way: int
    quiet_since: float
    on_close: Callable[[Connection], None]

    def end(self) -> None:
        """Let the loop find it closed by its other end."""
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        super().close()
        self.on_close(self)


class Door(socket.socket):
    """A listening socket that keeps `DoorLimits`.

    Args:
        listener: is taken over. limits: of its connections. clock: seconds, never stepping.
        files: that the process may have open.
    """

    def __init__(
        self,
        listener: socket.socket,
        limits: DoorLimits,
        clock: Callable[[], float] = time.monotonic,
        files: int = 1024,
    ) -> None:
        super().__init__(listener.family, listener.type, listener.proto, fileno=listener.detach())
        self.limits = limits
        # half of the descriptors are for what the connections need behind the door
        self._most = min(limits.connections, max(8, files // 2))
        self._clock = clock
        # the oldest first
        self._open: dict[Address, Connection] = {}
        self._by_host: Counter[str] = Counter()

    def accept(self) -> tuple[socket.socket, Address]:
        """Take the next connection, and end another one where there are too many."""
        descriptor, address = self._accept()  # type: ignore[attr-defined]
        taken = Connection(self.family, self.type, self.proto, fileno=descriptor)
        taken.address, taken.holder = (address[0], address[1]), ""
        taken.under_way, taken.quiet_since = 0, self._clock()
        taken.on_close = self._forget
        self._open[taken.address] = taken
        self._by_host[taken.address[0]] += 1
        if self._by_host[taken.address[0]] > self.limits.address_connections:
            self._end_one(taken.address[0])
        if len(self._open) > self._most:
            # of the address that has most
            self._end_one(self._by_host.most_common(1)[0][0])
        return taken, address

    def begin(self, address: Address, holder: str) -> None:
        """A request's head has come; ``holder``: whose secret it shows."""
        connection = self._open.get(address)
        if connection is None:
            return
        connection.under_way += 1
        if holder and holder != connection.holder:
            connection.holder = holder
            held = [each for each in self._open.values() if each.holder == holder]
            if len(held) > self.limits.holder_connections:
                min(held, key=lambda each: (each.under_way, each.quiet_since)).end()

    def finish(self, address: Address) -> None:
        """A request has been answered."""
        connection = self._open.get(address)
        if connection is not None:
            connection.under_way -= 1
            connection.quiet_since = self._clock()

    def abort(self, address: Address) -> None:
        """End a connection that keeps no time limit."""
        connection = self._open.get(address)
        if connection is not None:
            connection.end()

    def end_quiet(self) -> None:
        """End the connections that have been without a request for too long."""
        until = self._clock() - self.limits.quiet_s
        for connection in list(self._open.values()):
            if not connection.under_way and connection.quiet_since < until:
                connection.end()

    async def watch(self) -> None:
        """Look for quiet connections, until it is cancelled."""
        while True:
            await asyncio.sleep(self.limits.quiet_s / 4.0)
            self.end_quiet()

    def _end_one(self, host: str) -> None:
        of_host = [each for each in self._open.values() if each.address[0] == host]
        # without a secret before those with one, without a request before those with one, then the oldest;
        # the new one itself where all others are at work for who may
        idle = [each for each in of_host[:-1] if not (each.holder and each.under_way)]
        chosen = min(idle, key=lambda each: (bool(each.holder), bool(each.under_way)), default=of_host[-1])
        chosen.end()
        # its place is free now; the loop closes it when it comes round
        self._forget(chosen)

    def _forget(self, connection: Connection) -> None:
        if self._open.get(connection.address) is connection:
            del self._open[connection.address]
            host = connection.address[0]
            self._by_host[host] -= 1
            if not self._by_host[host]:
                del self._by_host[host]


class LimitedRequests:
    """Keeps the limits of requests: size and time of the body while it is read, time of the answer.

    Args:
        app: answers. door: where connections come in. holder_of: whose secret the head of a request shows;
            empty: nobody's.
    """

    def __init__(self, app: ASGIApp, door: Door, holder_of: Callable[[HTTPConnection], str]) -> None:
        self._app = app
        self._door = door
        self._holder_of = holder_of

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        host, port = scope["client"] or ("", 0)
        address = (host, port)
        self._door.begin(address, self._holder_of(HTTPConnection(scope)))
        try:
            if scope["type"] == "websocket":
                await self._app(scope, receive, send)
            else:
                await self._exchange(address, scope, receive, send)
        finally:
            self._door.finish(address)

    async def _exchange(self, address: Address, scope: Scope, receive: Receive, send: Send) -> None:
        limits = self._door.limits
        body = limits.body_of(scope["path"])
        most = body.size
        began = gone = False
        # with which a limit that was not kept is answered; frameworks wrap the exception that ends them
        refusal = 0
        taken, complete = 0, False
        clock = asyncio.get_running_loop().time
        until = clock() + body.time_s

        def refuse(status: int) -> _Refused:
            nonlocal refusal
            refusal = status
            return _Refused()

        async def take() -> Message:
            nonlocal taken, complete, gone
            if complete:
                # whether the client is still there, for as long as its answer takes
                message = await receive()
                gone = message["type"] == "http.disconnect"
                return message
            try:
                message = await asyncio.wait_for(receive(), max(0.0, until - clock()))
            except TimeoutError:
                raise refuse(408) from None
            gone = message["type"] == "http.disconnect"
            taken += len(message.get("body", b""))
            if taken > most:
                raise refuse(413)
            complete = not message.get("more_body", False)
            return message

        async def give(message: Message) -> None:
            nonlocal began
            began = True
            try:
                await asyncio.wait_for(send(message), limits.send_s)
            except TimeoutError:
                self._door.abort(address)
                raise refuse(408) from None

        try:
            length = dict(scope["headers"]).get(b"content-length", b"0")
            if length.isdigit() and int(length) > most:
                raise refuse(413)
            await self._app(scope, take, give)
        except asyncio.CancelledError:
            raise
        except BaseException as error:
            # what frameworks make of a client that does not wait for its answer, or of a request to a socket
            # that is none, is no fault of theirs
            if not (refusal or gone or error.args == UNANSWERED):
                raise
            if not refusal:
                log.warning("a request had no answer: %s", type(error).__name__)
            if began:
                self._door.abort(address)
            elif not gone:
                await _answer(send, refusal or 400, most)


async def _answer(send: Send, status: int, most: int) -> None:
    """Refuse a request."""
    message, hint = {
        400: ("the request is none that is answered here", "see /openapi.json"),
        408: ("the request took too long", "send it again"),
        413: (f"the body is larger than {most} bytes", "send the program in parts"),
    }[status]
    headers = [(b"content-type", b"application/json"), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    body = msgspec.json.encode({"code": "MC500", "message": message, "hint": hint})
    await send({"type": "http.response.body", "body": body})


class _Refused(BaseException):
    """A request that keeps no limit; no handler of the application's takes it for an error of its own."""
