"""Where a page or a gateway is served: what protects the address, the listening socket, and the serving."""

from __future__ import annotations

import asyncio
import logging
import math
import signal
import socket
import ssl
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from mcserver.doors.limits import Door, DoorLimits, LimitedRequests
from mcserver.errors import ConfigurationError, ServiceError
from mcserver.processes import raise_file_limit
from mcserver.terminal import visible

# of those that read what comes from outside, and of tasks that nobody waits for
LIBRARY_LOGS = ("uvicorn.error", "engineio.server", "socketio.server", "asyncio")
OWN_PACKAGES = frozenset({"mcserver", "mcclient"})
# lines of a log about what clients send, of each logger in a period [s]
MOST_LINES, PERIOD_S = 10, 60.0
LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})
# as a Host header names them
OWN_HOSTS = tuple(f"[{name}]" if ":" in name else name for name in sorted(LOOPBACK))


class Address(msgspec.Struct, frozen=True):
    """Where an application is served, and with which TLS.

    Attributes:
        host, port: port 0 takes a free one. certificate, key: TLS (PEM). on_ready: called once with the URL.
    """

    host: str
    port: int
    certificate: Path | None = None
    key: Path | None = None
    on_ready: Callable[[str], None] | None = None


@dataclass(frozen=True)
class Protection:
    """What keeps others from an application: the words and the code for where it is missing.

    Attributes:
        code: of the refusals. served: the application. secrets: what its clients identify themselves with.
        remedy: how to have secrets.
    """

    code: str
    served: str
    secrets: str
    remedy: str

    def require(self, address: Address, *, has_secrets: bool) -> None:
        """Check that nobody elsewhere gets in without a secret, and no secret crosses the network in clear.

        Raises:
            ConfigurationError: ``code`` an address that others reach without secrets or TLS, half a TLS.
        """
        local = address.host in LOOPBACK
        if not has_secrets and not local:
            raise ConfigurationError(
                self.code,
                f"without {self.secrets} {self.served} is served on this computer only, "
                f"not on {address.host}",
                self.remedy,
            )
        if (address.certificate is None) != (address.key is None):
            raise ConfigurationError(
                self.code, "TLS needs a certificate and its key", "give --certificate and --key"
            )
        if address.certificate is None and not local:
            raise ConfigurationError(
                self.code,
                f"{self.secrets} would cross the network to {address.host} in clear text",
                "give --certificate and --key, or serve on 127.0.0.1 behind a proxy with TLS",
            )


def listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens there; port 0 takes a free one.

    Raises:
        ServiceError: MC065 it cannot.
    """
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family, reuse_port=False)
    except OSError as error:
        raise ServiceError(
            "MC065", f"{host}:{port} cannot be listened on: {error.strerror}", "give another --host or --port"
        ) from error


def require_usable(certificate: Path, key: Path | None) -> None:
    """Check that a server can show a certificate (PEM).

    Raises:
        ServiceError: MC065 a file cannot be read, or the key is another one's.
    """
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
    except OSError as error:
        raise ServiceError(
            "MC065",
            f"the certificate {certificate} cannot be used with the key {key}: {error.strerror or error}",
            "give the PEM files of a certificate and of its own key",
        ) from error


def refuse_foreign_hosts(app: Starlette) -> None:
    """Keep a page of another site out that resolves its name to this computer."""
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=OWN_HOSTS)


async def serve_until_stopped(
    app: ASGIApp,
    listener: socket.socket,
    address: Address,
    *,
    limits: DoorLimits,
    holder_of: Callable[[HTTPConnection], str],
    max_frame_bytes: int,
    max_waiting_frames: int = 32,
) -> None:
    """Say that it is ready, and serve an application until SIGTERM or SIGINT.

    Args:
        limits: of connections and requests. holder_of: whose secret a request shows; empty: nobody's.
        max_frame_bytes: of a WebSocket. max_waiting_frames: that are read before they are taken.

    Raises:
        ServiceError: MC065 the certificate cannot be used.
    """
    if address.certificate is not None:
        require_usable(address.certificate, address.key)
    if address.on_ready is not None:
        scheme = "https" if address.certificate is not None else "http"
        address.on_ready(f"{scheme}://{address.host}:{listener.getsockname()[1]}/")
    door = Door(listener, limits, files=raise_file_limit())
    config = uvicorn.Config(
        # a proxy in front names its clients; the door counts its own connections
        LimitedRequests(cast(ASGIApp, ProxyHeadersMiddleware(cast(Any, app))), door, holder_of),
        proxy_headers=False,
        # bounds the head of a request, which the quicker parser does not
        http="h11",
        log_level="warning",
        # its own would write what others send as it is
        log_config=None,
        lifespan="on",
        ws_max_size=max_frame_bytes,
        ws_max_queue=max_waiting_frames,
        ssl_certfile=address.certificate,
        ssl_keyfile=address.key,
        timeout_graceful_shutdown=2,
    )
    server = uvicorn.Server(config)
    loop = asyncio.get_running_loop()
    few = FewLines()
    for handler in (*logging.getLogger().handlers, logging.lastResort):
        if handler is not None:
            handler.addFilter(few)
    for name in LIBRARY_LOGS:
        logging.getLogger(name).addFilter(WithoutTracebacks())
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: loop.call_soon_threadsafe(setattr, server, "should_exit", True))
    # not `serve`: it puts handlers of its own in the place of ours, and raises the signal again at last
    watch = asyncio.ensure_future(door.watch())
    try:
        await server._serve(sockets=[door])
    finally:
        watch.cancel()


class WithoutTracebacks(logging.Filter):
    """Shortens what libraries log of bytes that they cannot read: that ends one connection or one event."""

    def filter(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        if error is not None and not _is_own(error):
            record.msg = "what a client sent could not be understood: %s: %s"
            record.args = (type(error).__name__, visible(str(error)))
            record.exc_info = None
        return True


class FewLines(logging.Filter):
    """Bounds what doors and libraries log: who sends garbage fills no disk by the lines about it.

    Faults of this project's own code are never left out.

    Args:
        clock: seconds, never stepping.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._period_end = -math.inf
        self._lines: Counter[str] = Counter()
        self._left_out: Counter[str] = Counter()

    def filter(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        package = record.name.partition(".")[0]
        own = package in OWN_PACKAGES and not record.name.startswith("mcserver.doors")
        if own or (error is not None and _is_own(error)):
            return True
        now = self._clock()
        if now >= self._period_end:
            self._period_end = now + PERIOD_S
            self._lines.clear()
        self._lines[record.name] += 1
        if self._lines[record.name] > MOST_LINES:
            self._left_out[record.name] += 1
            return False
        left_out = self._left_out.pop(record.name, 0)
        if left_out:
            record.msg, record.args = f"{record.getMessage()} ({left_out} lines before it left out)", ()
        return True


def _is_own(error: BaseException) -> bool:
    """Return whether an exception has come through this project's own code, beyond the door."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    names = [frame.f_globals.get("__name__", "") for frame in frames]
    # all requests come through the door
    packages = {name.partition(".")[0] for name in names if not name.startswith("mcserver.doors.limits")}
    return bool(packages & OWN_PACKAGES)
