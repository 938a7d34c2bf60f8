"""The gateway's process: WebSocket and HTTP on one ASGI application, served until it is stopped."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
from fastapi import FastAPI, WebSocket
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from mcserver.errors import ConfigurationError
from mcserver.gateway.http import MAX_BODY_BYTES, HttpSessions, build_http
from mcserver.gateway.tokens import read_tokens
from mcserver.gateway.websocket import Sessions
from mcserver.web.listening import LOOPBACK, listen, serve_until_stopped

MAX_FRAME_BYTES = 1024 * 1024


class GatewayOptions(msgspec.Struct, frozen=True):
    """How the gateway is served.

    Attributes:
        host, port: where; port 0 takes a free one. connect: Zenoh endpoints; empty: this computer.
        config_file: a Zenoh configuration for TLS. tokens: the token file; None: loopback only, no token.
        origins: web origins whose pages may connect. certificate, key: TLS (PEM).
        on_ready: called once with the address.
    """

    host: str
    port: int
    connect: tuple[str, ...] = ()
    config_file: Path | None = None
    tokens: Path | None = None
    origins: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None
    on_ready: Callable[[str], None] | None = None


async def serve(options: GatewayOptions) -> None:
    """Serves until SIGTERM or SIGINT.

    Raises:
        ConfigurationError: MC070 the token file, MC074 an address that others reach without a token or TLS.
        ServiceError: MC065 the address cannot be listened on.
    """
    tokens = None if options.tokens is None else read_tokens(options.tokens)
    if tokens is None and options.host not in LOOPBACK:
        raise ConfigurationError(
            "MC074",
            f"without tokens the gateway is served on this computer only, not on {options.host}",
            "make a token with mcserver gateway --add-token NAME, and give the file with --tokens",
        )
    if (options.certificate is None) != (options.key is None):
        raise ConfigurationError(
            "MC074", "TLS needs a certificate and its key", "give --certificate and --key"
        )
    if options.certificate is None and options.host not in LOOPBACK:
        raise ConfigurationError(
            "MC074",
            f"tokens would cross the network to {options.host} in clear text",
            "give --certificate and --key, or serve on 127.0.0.1 behind a proxy with TLS",
        )
    sessions = Sessions(tokens, options.connect, options.config_file, frozenset(options.origins))
    http = HttpSessions(sessions, options.connect, options.config_file)
    app = build_app(sessions, http, local=tokens is None)
    listener = listen(options.host, options.port)
    if options.on_ready is not None:
        scheme = "https" if options.certificate is not None else "http"
        options.on_ready(f"{scheme}://{options.host}:{listener.getsockname()[1]}/")
    await serve_until_stopped(
        app,
        listener,
        options.certificate,
        options.key,
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
