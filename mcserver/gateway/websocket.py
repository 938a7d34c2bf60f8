"""The WebSocket: one connection a session, frames in and out, and what ends it."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

import msgspec
from mcclient.errors import MotionError
from starlette.websockets import WebSocket, WebSocketDisconnect

from mcserver.gateway import frames
from mcserver.gateway.session import GRACE_S, GatewaySession, SlowReader
from mcserver.gateway.tokens import LOCAL, Principal, Tokens

log = logging.getLogger(__name__)

MAX_SESSIONS = 64
# close codes (RFC 6455, 7.4): 4000-4999 are an application's own
BAD_FRAME, FORBIDDEN, TOO_MANY, TAKEN_OVER, NO_SERVER, SLOW = 4000, 4003, 4008, 4009, 4010, 4011


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
        # by the session's secret: what ends it once its grace is over
        self._ends: dict[str, asyncio.Task[None]] = {}
        self._decode = msgspec.msgpack.Decoder(frames.Request).decode

    def principal(self, token: str) -> Principal | None:
        """Who holds a token; without a token file everybody is local."""
        return LOCAL if self.tokens is None else self.tokens.principal(token)

    async def close(self) -> None:
        """Ends all sessions."""
        for task in self._ends.values():
            task.cancel()
        await asyncio.gather(
            *(session.close() for session in self._sessions.values()), return_exceptions=True
        )

    async def serve(self, socket: WebSocket) -> None:
        """One connection, from its handshake to its end."""
        offered = [each.strip() for each in socket.headers.get("sec-websocket-protocol", "").split(",")]
        origin = socket.headers.get("origin")
        if frames.SUBPROTOCOL not in offered or (origin is not None and origin not in self._origins):
            await socket.close(FORBIDDEN, "subprotocol mc.v1 is needed, and an origin that is allowed")
            return
        principal = self.principal(_token(socket, offered))
        if principal is None:
            await socket.close(FORBIDDEN, "a token is needed")
            return
        await socket.accept(frames.SUBPROTOCOL)
        try:
            session, resumed = await self._session(socket.query_params.get("session", ""), principal)
        except MotionError as error:
            await socket.close(NO_SERVER if error.code == "MC530" else TOO_MANY, error.message[:120])
            return
        session.connection = socket
        session.outbox.put(
            frames.Hello(session.client, session.secret, principal.role.name.lower(), resumed, GRACE_S)
        )
        await self._exchange(socket, session)
        if session.connection is socket:
            session.connection = None
            session.end_subscriptions()
            self._ends[session.secret] = asyncio.ensure_future(self._end_after_grace(session))

    async def _session(self, secret: str, principal: Principal) -> tuple[GatewaySession, bool]:
        known = self._sessions.get(secret)
        if known is not None and known.principal == principal:
            if isinstance(known.connection, WebSocket):
                # the old connection is dead and does not know it yet
                await _close(known.connection, TAKEN_OVER, "taken up by another connection")
            known.end_subscriptions()
            # the grace begins anew with the next loss
            ending = self._ends.pop(secret, None)
            if ending is not None:
                ending.cancel()
            return known, True
        if len(self._sessions) >= MAX_SESSIONS:
            raise MotionError("MC071", f"{MAX_SESSIONS} clients are connected", "close one")
        session = await GatewaySession.open(self._connect, self._config_file, principal)
        self._sessions[session.secret] = session
        return session, False

    async def _end_after_grace(self, session: GatewaySession) -> None:
        await asyncio.sleep(GRACE_S)
        if session.connection is None:
            del self._sessions[session.secret]
            del self._ends[session.secret]
            await session.close()

    async def _exchange(self, socket: WebSocket, session: GatewaySession) -> None:
        """Frames both ways, until one of them ends."""
        tasks = [
            asyncio.ensure_future(self._receive(socket, session)),
            asyncio.ensure_future(_send(socket, session)),
        ]
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            task.cancel()
        for outcome in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(outcome, SlowReader):
                await _close(socket, SLOW, "the replies are not read")
            elif isinstance(outcome, _BadFrame):
                await _close(socket, BAD_FRAME, str(outcome)[:120])
            elif isinstance(outcome, Exception) and not isinstance(outcome, WebSocketDisconnect):
                log.debug("a connection ended: %s", outcome)

    async def _receive(self, socket: WebSocket, session: GatewaySession) -> None:
        while True:
            await session.outbox.room()
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                raise WebSocketDisconnect(message.get("code", 1006))
            written = message.get("bytes")
            if written is None:
                raise _BadFrame("frames are binary: MessagePack")
            try:
                request = self._decode(written)
            # invalid UTF-8 and deep nesting have errors of their own
            except Exception as error:
                raise _BadFrame(f"not a frame: {error}") from error
            session.handle(request)


class _BadFrame(Exception):
    """What came is no frame; the connection ends with its reason."""


async def _send(socket: WebSocket, session: GatewaySession) -> None:
    while True:
        await socket.send_bytes(await session.outbox.take())


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    try:
        await socket.close(code, reason)
    except RuntimeError:
        log.debug("it was closed already")


def _token(socket: WebSocket, offered: list[str]) -> str:
    """From the header ``Authorization``, or, as browsers cannot set it, from the subprotocols offered."""
    scheme, _, token = socket.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        return token.strip()
    return next(
        (each[len(frames.TOKEN_PREFIX) :] for each in offered if each.startswith(frames.TOKEN_PREFIX)), ""
    )
