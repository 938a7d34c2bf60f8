"""Serve agents over HTTP: who may connect, and from which pages."""

from __future__ import annotations

import asyncio
import hmac
import stat
from pathlib import Path
from typing import Any

import msgspec
from mcp.server.mcpserver import MCPServer
from mcp.server.transport_security import TransportSecuritySettings
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from mcserver.doors.limits import BodyLimit, DoorLimits
from mcserver.doors.listening import LOOPBACK, OWN_HOSTS, Address, Protection, listen, serve_until_stopped
from mcserver.errors import ConfigurationError

MIN_TOKEN = 20  # characters: what is shorter can be guessed
MAX_TOKEN_FILE = 4096  # bytes
# a program is a request's argument
MAX_BODY_BYTES, BODY_S = 16 * 1024 * 1024, 60.0
MAX_FRAME_BYTES = 64 * 1024
PROTECTION = Protection("MC082", "the agents' server", "a token", "give --token-file, or serve on 127.0.0.1")


class AgentAccess(msgspec.Struct, frozen=True):
    """Where agents are served, and who gets in.

    Attributes:
        token: that every request has to bring; None: none, on this computer only.
        origins: of pages that may connect besides those of this computer, such as ``https://cell.example``.
    """

    address: Address
    token: str | None = None
    origins: tuple[str, ...] = ()

    @property
    def local(self) -> bool:
        """Return True if only this computer reaches it."""
        return self.address.host in LOOPBACK

    def require_protection(self) -> None:
        """Check that nobody elsewhere gets in without the token, and that it never crosses a network bare.

        Raises:
            ConfigurationError: MC082 it is not so.
        """
        PROTECTION.require(self.address, has_secrets=self.token is not None)

    def shows_token(self, authorization: bytes) -> bool:
        """Return whether a header shows the token; False where there is none."""
        return self.token is not None and hmac.compare_digest(authorization, f"Bearer {self.token}".encode())


def read_token(file: Path) -> str:
    """Read the token from the only line of a file that nobody else may read.

    Raises:
        ConfigurationError: MC082 it cannot be read, others can read it, or its token is too short.
    """
    try:
        with file.open("rb") as stream:
            mode = stat.S_IMODE(file.stat().st_mode)
            token = stream.read(MAX_TOKEN_FILE + 1).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or "it is not ASCII"
        raise ConfigurationError(
            "MC082", f"the token file {file} cannot be read: {reason}", "one line with the token"
        ) from error
    if mode & 0o077:
        raise ConfigurationError("MC082", f"others can read {file} (mode {mode:03o})", f"chmod 600 {file}")
    if not MIN_TOKEN <= len(token) <= MAX_TOKEN_FILE or not token.isprintable() or " " in token:
        raise ConfigurationError(
            "MC082",
            f"{file} has no token of {MIN_TOKEN} characters or more",
            f"openssl rand -hex 32 > {file}",
        )
    return token


class Guard:
    """Refuses requests without the token, and those of pages of other origins, before anything reads them.

    Args:
        app: what is protected.
    """

    def __init__(self, app: ASGIApp, access: AgentAccess) -> None:
        self._app = app
        self._access = access
        self._origins = None if access.local else frozenset(each.encode() for each in access.origins)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection."""
        if scope["type"] == "http":
            headers = [(name.lower(), value) for name, value in scope["headers"]]
            given = [value for name, value in headers if name == b"authorization"]
            origins = [value for name, value in headers if name == b"origin"]
            if self._access.token is not None and not (
                len(given) == 1 and self._access.shows_token(given[0])
            ):
                refusal = PlainTextResponse("a bearer token is needed", 401, {"www-authenticate": "Bearer"})
                await refusal(scope, receive, send)
                return
            if self._origins is not None and not self._origins.issuperset(origins):
                refusal = PlainTextResponse("pages of this origin may not connect", 403)
                await refusal(scope, receive, send)
                return
        elif scope["type"] != "lifespan":
            return
        await self._app(scope, receive, send)


def protect(server: MCPServer[Any], access: AgentAccess) -> ASGIApp:
    """Build the application at ``/mcp`` behind its guard.

    On this computer the Host header has to name it too: a page whose name was bound anew cannot get in.
    """
    security = TransportSecuritySettings(
        enable_dns_rebinding_protection=access.local,
        allowed_hosts=[f"{name}:*" for name in OWN_HOSTS],
        allowed_origins=[
            *(f"{scheme}://{name}:*" for name in OWN_HOSTS for scheme in ("http", "https")),
            *access.origins,
        ],
    )
    return Guard(server.streamable_http_app(host=access.address.host, transport_security=security), access)


def serve(server: MCPServer[Any], access: AgentAccess) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        ConfigurationError: MC082 others reach the address without a token or TLS.
        ServiceError: MC065 the address cannot be listened on, or the certificate cannot be used.
    """
    access.require_protection()

    def holder_of(connection: HTTPConnection) -> str:
        given = connection.headers.get("authorization", "").encode()
        return "agent" if access.shows_token(given) else ""

    address = access.address
    asyncio.run(
        serve_until_stopped(
            protect(server, access),
            listen(address.host, address.port),
            address,
            limits=DoorLimits(body=BodyLimit(MAX_BODY_BYTES, BODY_S)),
            holder_of=holder_of,
            max_frame_bytes=MAX_FRAME_BYTES,
        )
    )
