"""The WebSocket: one connection a session, frames in and out, and what ends it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import msgspec
from mcclient.errors import MotionError
from starlette.requests import HTTPConnection
from starlette.websockets import WebSocket, WebSocketDisconnect

from mcserver.gateway import frames
from mcserver.gateway.session import GRACE_S, GatewaySession, SlowReader
from mcserver.gateway.tokens import LOCAL, Principal, Tokens

log = logging.getLogger(__name__)

MAX_SESSIONS = 64
# of one token, and of one address; without a token file everybody is local
TOKEN_SESSIONS, ADDRESS_SESSIONS = 16, 32
# close codes (RFC 6455, 7.4): 4000-4999 are an application's own
BAD_FRAME, FORBIDDEN, TOO_MANY, TAKEN_OVER, NO_SERVER, SLOW = 4000, 4003, 4008, 4009, 4010, 4011
# how long the other end may take to hear why its connection is closed
CLOSE_S = 2.0
# what clients say that close on purpose; a link that breaks is reported as one closed without a code
NORMAL_CLOSURE = 1000
# what its subprotocols begin with
FOXGLOVE = "foxglove."


class Sessions:
    """All sessions of the gateway, connected or within their grace.

    Args:
        tokens: who may; None: everybody (loopback only). connect, config_file: where the motion servers are.
        origins: web origins whose pages may connect; a client that is no browser sends none.
    """

    def __init__(
        self,
        tokens: Tokens | None,
        connect: tuple[str, ...],
        config_file: Path | None,
        origins: frozenset[str],
    ) -> None:
        self.tokens = tokens
        self._connect = connect
        self._config_file = config_file
        self._origins = origins
        self._sessions: dict[str, GatewaySession] = {}
        # who has a place: those that are being opened too
        self._places: list[_Place] = []
        self._place_of: dict[str, _Place] = {}
        # by the session's secret: what ends it once its grace is over
        self._ends: dict[str, asyncio.Task[None]] = {}
        self._ending: set[asyncio.Task[None]] = set()
        self._decode = msgspec.msgpack.Decoder(frames.Request).decode

    def principal(self, token: str) -> Principal | None:
        """Who holds a token; without a token file everybody is local."""
        return LOCAL if self.tokens is None else self.tokens.principal(token)

    def holder(self, connection: HTTPConnection) -> str:
        """Name of the token that a request shows; empty: none that is known."""
        principal = self.principal(token_of(connection)) if self.tokens is not None else None
        return "" if principal is None else principal.name

    async def close(self) -> None:
        """End all sessions."""
        for task in self._ends.values():
            task.cancel()
        await asyncio.gather(
            *(session.close() for session in self._sessions.values()), *self._ending, return_exceptions=True
        )

    async def let_in(self, socket: WebSocket, protocols: tuple[str, ...]) -> Principal | None:
        """Accept a connection in the first of the subprotocols that it offers.

        Returns:
            Who it is; None: it is closed, since it offers none of them, or lacks a token or the right origin.
        """
        offered = _offered(socket)
        protocol = next((each for each in protocols if each in offered), None)
        origin = socket.headers.get("origin")
        if protocol is None or (origin is not None and origin not in self._origins):
            said = f"subprotocol {protocols[0]} is needed, and an origin that is allowed"
            await close_socket(socket, FORBIDDEN, said)
            return None
        principal = self.principal(token_of(socket))
        if principal is None:
            await close_socket(socket, FORBIDDEN, "a token is needed")
            return None
        await socket.accept(protocol)
        return principal

    async def serve(self, socket: WebSocket) -> None:
        """One connection, from its handshake to its end."""
        principal = await self.let_in(socket, (frames.SUBPROTOCOL,))
        if principal is None:
            return
        try:
            session, resumed = await self._session(
                socket.query_params.get("session", ""),
                _Place(principal.name, socket.client.host if socket.client is not None else ""),
                principal,
            )
        except MotionError as error:
            await close_socket(socket, NO_SERVER if error.code == "MC530" else TOO_MANY, error.message[:120])
            return
        connection = Connection(socket, session)
        session.connection = connection
        session.outbox.put(
            frames.Hello(session.client, session.secret, principal.role.value, resumed, GRACE_S)
        )
        session.back()
        await connection.exchange(self._decode)
        if session.connection is connection:
            session.connection = None
            session.end_subscriptions()
            if connection.closed_by_client:
                await session.leave()
            session.away()
            self._ends[session.secret] = asyncio.ensure_future(self._end_after_grace(session))

    async def _session(self, secret: str, place: _Place, principal: Principal) -> tuple[GatewaySession, bool]:
        known = self._sessions.get(secret)
        if known is not None and known.principal == principal:
            # the old connection is dead and does not know it yet; another one may be quicker meanwhile
            ended: Connection | None = None
            while isinstance(known.connection, Connection) and known.connection is not ended:
                ended = known.connection
                await ended.end()
            known.end_subscriptions()
            # the grace begins anew with the next loss
            ending = self._ends.pop(secret, None)
            if ending is not None:
                ending.cancel()
            return known, True
        self._take_place(place)
        try:
            session = await GatewaySession.open(self._connect, self._config_file, principal)
        except BaseException:
            self._places.remove(place)
            raise
        self._sessions[session.secret] = session
        self._place_of[session.secret] = place
        return session, False

    def _take_place(self, place: _Place) -> None:
        limits = [("clients", MAX_SESSIONS, len(self._places))]
        if self.tokens is not None:
            limits += [
                ("clients with this token", TOKEN_SESSIONS, [p.name for p in self._places].count(place.name)),
                ("clients of this host", ADDRESS_SESSIONS, [p.host for p in self._places].count(place.host)),
            ]
        for what, most, taken in limits:
            if taken >= most and not self._end_idle(place if most != MAX_SESSIONS else None):
                raise MotionError("MC071", f"{most} {what} are connected", "close one")
        self._places.append(place)

    def _end_idle(self, place: _Place | None) -> bool:
        """End a session within its grace that has opened nothing; whether there was one, of this place."""
        for secret, task in self._ends.items():
            session = self._sessions[secret]
            if not session.has_opened and (place is None or self._place_of[secret] == place):
                task.cancel()
                self._end(session)
                return True
        return False

    async def _end_after_grace(self, session: GatewaySession) -> None:
        await asyncio.sleep(session.grace_s)
        if session.connection is None:
            self._end(session)

    def _end(self, session: GatewaySession) -> None:
        del self._sessions[session.secret]
        del self._ends[session.secret]
        self._places.remove(self._place_of.pop(session.secret))
        ending = asyncio.ensure_future(session.close())
        self._ending.add(ending)
        ending.add_done_callback(self._ending.discard)


class _Place(NamedTuple):
    """What a session counts for: its token's name and its client's address."""

    name: str
    host: str


class Connection:
    """Frames both ways between a socket and its session, until one ends or another takes the session up."""

    def __init__(self, socket: WebSocket, session: GatewaySession) -> None:
        self._socket = socket
        self._session = session
        self._taken_up = asyncio.Event()
        # whether the client has ended it in order, as one that does not come back
        self.closed_by_client = False
        # set once this connection takes nothing from the session any more
        self._idle = asyncio.Event()

    async def exchange(self, decode: Callable[[bytes], frames.Request]) -> None:
        """Carry frames until the connection ends, and say to the other end why."""
        tasks = [
            asyncio.ensure_future(self._receive(decode)),
            asyncio.ensure_future(self._send()),
            asyncio.ensure_future(self._taken_up.wait()),
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            outcomes = await asyncio.gather(*tasks, return_exceptions=True)
            self._idle.set()
        if self._taken_up.is_set():
            await close_socket(self._socket, TAKEN_OVER, "taken up by another connection")
        for outcome in outcomes:
            if isinstance(outcome, SlowReader):
                await close_socket(self._socket, SLOW, "the replies are not read")
            elif isinstance(outcome, _BadFrame):
                await close_socket(self._socket, BAD_FRAME, str(outcome)[:120])
            elif isinstance(outcome, Exception) and not isinstance(outcome, WebSocketDisconnect):
                log.debug("a connection ended: %s", outcome)

    async def end(self) -> None:
        """Leave the session to another connection; what is sent from now on is the other's."""
        self._taken_up.set()
        await self._idle.wait()

    async def _receive(self, decode: Callable[[bytes], frames.Request]) -> None:
        while True:
            await self._session.outbox.room()
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                self.closed_by_client = message.get("code") == NORMAL_CLOSURE
                raise WebSocketDisconnect(message.get("code", 1006))
            written = message.get("bytes")
            if written is None:
                raise _BadFrame("frames are binary: MessagePack")
            try:
                request = decode(written)
            # invalid UTF-8 and deep nesting have errors of their own
            except Exception as error:
                raise _BadFrame(f"not a frame: {error}") from error
            self._session.handle(request)

    async def _send(self) -> None:
        while True:
            await self._socket.send_bytes(await self._session.outbox.take())


class _BadFrame(Exception):
    """What came is no frame; the connection ends with its reason."""


async def close_socket(socket: WebSocket, code: int, reason: str) -> None:
    """Close a connection; one that is gone, or takes nothing, is left to its transport."""
    try:
        await asyncio.wait_for(socket.close(code, reason), CLOSE_S)
    except (RuntimeError, WebSocketDisconnect, TimeoutError):
        log.debug("it was closed already, or reads nothing")


def token_of(connection: HTTPConnection) -> str:
    """Return the token of ``Authorization`` or, since browsers cannot set it, of the subprotocols offered."""
    offered = _offered(connection)
    scheme, _, token = connection.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        return token.strip()
    # a Foxglove viewer has its address alone to give one
    address = any(each.startswith(FOXGLOVE) for each in offered) and connection.query_params.get("token")
    return next(
        (each[len(frames.TOKEN_PREFIX) :] for each in offered if each.startswith(frames.TOKEN_PREFIX)),
        address or "",
    )


def _offered(connection: HTTPConnection) -> list[str]:
    return [each.strip() for each in connection.headers.get("sec-websocket-protocol", "").split(",")]
