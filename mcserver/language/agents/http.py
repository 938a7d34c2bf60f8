"""Serve agents over HTTP: who may connect, and from which pages."""

from __future__ import annotations

import asyncio
import hmac
import stat
from collections.abc import Awaitable, Callable, MutableMapping
from pathlib import Path
from typing import Any

import msgspec
from mcp.server.mcpserver import MCPServer
from mcp.server.transport_security import TransportSecuritySettings
from starlette.requests import HTTPConnection

from mcserver.doors.limits import BodyLimit, DoorLimits
from mcserver.doors.listening import Address, listen, serve_until_stopped
from mcserver.errors import ConfigurationError

LOOPBACK = ("127.0.0.1", "localhost", "::1")
MIN_TOKEN = 20  # characters: what is shorter can be guessed
MAX_TOKEN_FILE = 4096  # bytes
# a program is a request's argument
MAX_BODY_BYTES, BODY_S = 16 * 1024 * 1024, 60.0
MAX_FRAME_BYTES = 64 * 1024

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]


class HttpAddress(msgspec.Struct, frozen=True):
    """Where agents are served.

    Attributes:
        token: that every request has to bring; None: none, on this computer only.
        origins: of pages that may connect besides those of this computer, such as ``https://cell.example``.
        certificate, key: TLS (PEM).
    """

    host: str
    port: int
    token: str | None = None
    origins: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None

    @property
    def local(self) -> bool:
        """Return True if only this computer reaches it."""
        return self.host in LOOPBACK

    def require_protection(self) -> None:
        """Check that nobody elsewhere gets in without the token, and that it never crosses a network bare.

        Raises:
            ConfigurationError: MC082 it is not so.
        """
        if (self.certificate is None) != (self.key is None):
            raise ConfigurationError(
                "MC082", "TLS needs a certificate and its key", "--certificate and --key"
            )
        for file in (self.certificate, self.key):
            if file is not None and not file.is_file():
                raise ConfigurationError("MC082", f"there is no file {file}", "PEM files are needed")
        if self.local:
            return
        if self.token is None:
            raise ConfigurationError(
                "MC082",
                f"without a token agents are served on this computer only, not on {self.host}",
                "give --token-file, or serve on 127.0.0.1",
            )
        if self.certificate is None:
            raise ConfigurationError(
                "MC082",
                f"the token would cross the network to {self.host} in clear text",
                "give --certificate and --key, or serve on 127.0.0.1 behind a proxy with TLS",
            )


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

    def __init__(self, app: Application, address: HttpAddress) -> None:
        self._app = app
        self._expected = None if address.token is None else f"Bearer {address.token}".encode()
        self._origins = None if address.local else frozenset(each.encode() for each in address.origins)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection."""
        if scope["type"] == "http":
            headers = [(name.lower(), value) for name, value in scope["headers"]]
            given = [value for name, value in headers if name == b"authorization"]
            origins = [value for name, value in headers if name == b"origin"]
            if self._expected is not None and not (
                len(given) == 1 and hmac.compare_digest(given[0], self._expected)
            ):
                await _refuse(send, 401, b"a bearer token is needed", (b"www-authenticate", b"Bearer"))
                return
            if self._origins is not None and not self._origins.issuperset(origins):
                await _refuse(send, 403, b"pages of this origin may not connect")
                return
        elif scope["type"] != "lifespan":
            return
        await self._app(scope, receive, send)


async def _refuse(send: Send, status: int, words: bytes, *headers: tuple[bytes, bytes]) -> None:
    plain = (b"content-type", b"text/plain")
    await send({"type": "http.response.start", "status": status, "headers": [plain, *headers]})
    await send({"type": "http.response.body", "body": words})


def protect(server: MCPServer[Any], address: HttpAddress) -> Application:
    """Build the application at ``/mcp`` behind its guard.

    On this computer the Host header has to name it too: a page whose name was bound anew cannot get in.
    """
    own = [f"[{name}]" if ":" in name else name for name in LOOPBACK]
    security = TransportSecuritySettings(
        enable_dns_rebinding_protection=address.local,
        allowed_hosts=[f"{name}:*" for name in own],
        allowed_origins=[
            *(f"{scheme}://{name}:*" for name in own for scheme in ("http", "https")),
            *address.origins,
        ],
    )
    return Guard(server.streamable_http_app(host=address.host, transport_security=security), address)


def serve(server: MCPServer[Any], address: HttpAddress) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        ServiceError: MC065 the address cannot be listened on.
    """
    token = address.token

    def holder_of(connection: HTTPConnection) -> str:
        given = connection.headers.get("authorization", "").encode()
        return "agent" if token is not None and hmac.compare_digest(given, f"Bearer {token}".encode()) else ""

    served = Address(address.host, address.port, address.certificate, address.key)
    asyncio.run(
        serve_until_stopped(
            protect(server, address),
            listen(address.host, address.port),
            served,
            limits=DoorLimits(body=BodyLimit(MAX_BODY_BYTES, BODY_S)),
            holder_of=holder_of,
            max_frame_bytes=MAX_FRAME_BYTES,
        )
    )
