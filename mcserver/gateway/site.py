"""The gateway's process: WebSocket and HTTP on one ASGI application, served until it is stopped."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
from fastapi import FastAPI, WebSocket
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from mcserver.gateway.http import MAX_BODY_BYTES, HttpSessions, build_http
from mcserver.gateway.tokens import read_tokens
from mcserver.gateway.websocket import Sessions
from mcserver.web.listening import LOOPBACK, Address, Protection, listen, serve_until_stopped

MAX_FRAME_BYTES = 1024 * 1024


class GatewayOptions(msgspec.Struct, frozen=True):
    """How the gateway is served.

    Attributes:
        connect: Zenoh endpoints; empty: this computer. config_file: a Zenoh configuration for TLS.
        tokens: the token file; None: loopback only, no token. origins: web origins whose pages may connect.
    """

    address: Address
    connect: tuple[str, ...] = ()
    config_file: Path | None = None
    tokens: Path | None = None
    origins: tuple[str, ...] = ()


PROTECTION = Protection(
    "MC074",
    "the gateway",
    "tokens",
    "make a token with mcserver gateway --add-token NAME, and give the file with --tokens",
)


async def serve(options: GatewayOptions) -> None:
    """Serve until SIGTERM or SIGINT.

    Raises:
        ConfigurationError: MC070 the token file, MC074 an address that others reach without a token or TLS.
        ServiceError: MC065 the address cannot be listened on.
    """
    tokens = None if options.tokens is None else read_tokens(options.tokens)
    PROTECTION.require(options.address, has_secrets=tokens is not None)
    sessions = Sessions(tokens, options.connect, options.config_file, frozenset(options.origins))
    http = HttpSessions(sessions, options.connect, options.config_file)
    app = build_app(sessions, http, local=tokens is None)
    listener = listen(options.address.host, options.address.port)
    await serve_until_stopped(
        app,
        listener,
        options.address,
        max_frame_bytes=MAX_FRAME_BYTES,
        # who does not read its replies is not read from for long
        max_waiting_frames=4,
    )


def build_app(sessions: Sessions, http: HttpSessions, *, local: bool) -> FastAPI:
    """``/v1/ws`` the WebSocket, ``/v1/…`` HTTP, ``/openapi.json`` its description."""

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        yield
        await sessions.close()
        await http.close()

    app = FastAPI(
        title="Motion server gateway", version="1", lifespan=lifespan, docs_url=None, redoc_url=None
    )
    app.add_middleware(LimitedBodies)
    if local:
        # a page of another site that resolves its name to this computer must not get in
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=[*LOOPBACK, "[::1]"])
    build_http(app, http)

    @app.websocket("/v1/ws")
    async def connect(socket: WebSocket) -> None:
        await sessions.serve(socket)

    return app


class LimitedBodies:
    """Refuses a body that is larger than `MAX_BODY_BYTES`, before it is in memory."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        taken = 0

        async def limited() -> Message:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            if taken > MAX_BODY_BYTES:
                return {"type": "http.disconnect"}
            return message

        length = dict(scope["headers"]).get(b"content-length", b"0")
        if length.isdigit() and int(length) > MAX_BODY_BYTES:
            await send(
                {
                    "type": "http.response.start",
                    "status": 413,
                    "headers": [(b"content-type", b"application/json")],
                }
            )
            await send({"type": "http.response.body", "body": _TOO_LARGE})
            return
        await self._app(scope, limited, send)


_TOO_LARGE = msgspec.json.encode(
    {
        "code": "MC500",
        "message": f"the body is larger than {MAX_BODY_BYTES} bytes",
        "hint": "send the program in parts",
    }
)
