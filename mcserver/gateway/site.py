"""The gateway's process: WebSocket and HTTP on one ASGI application, served until it is stopped."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
from fastapi import FastAPI, WebSocket

from mcserver.doors.limits import BodyLimit, DoorLimits
from mcserver.doors.listening import Address, Protection, listen, refuse_foreign_hosts, serve_until_stopped
from mcserver.gateway.http import MAX_BODY_BYTES, HttpSessions, build_http
from mcserver.gateway.tokens import read_tokens
from mcserver.gateway.websocket import Sessions

MAX_FRAME_BYTES = 1024 * 1024
BODY_S = 60.0


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
    add_foxglove(app, sessions, options)
    listener = listen(options.address.host, options.address.port)
    await serve_until_stopped(
        app,
        listener,
        options.address,
        limits=DoorLimits(body=BodyLimit(MAX_BODY_BYTES, BODY_S)),
        holder_of=sessions.holder,
        max_frame_bytes=MAX_FRAME_BYTES,
        # who does not read its replies is not read from for long
        max_waiting_frames=4,
    )


def add_foxglove(app: FastAPI, sessions: Sessions, options: GatewayOptions) -> None:
    """Add ``/v1/foxglove/{machine}``, where the extra that it needs is installed."""
    try:
        from mcserver.gateway.foxglove import Viewers
    except ModuleNotFoundError as error:
        if error.name != "foxglove_schemas_protobuf":
            raise
        return
    viewers = Viewers(sessions, options.connect, options.config_file)

    @app.websocket("/v1/foxglove/{machine}")
    async def show(socket: WebSocket, machine: str) -> None:
        await viewers.serve(socket, machine)


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
    if local:
        refuse_foreign_hosts(app)
    build_http(app, http)

    @app.websocket("/v1/ws")
    async def connect(socket: WebSocket) -> None:
        await sessions.serve(socket)

    return app
