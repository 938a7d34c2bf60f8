"""A listening socket for a page or a gateway, and what serves an application on it."""

from __future__ import annotations

import asyncio
import signal
import socket
from pathlib import Path

import uvicorn
from fastapi import FastAPI

from mcserver.errors import ServiceError

LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens there; port 0 takes a free one.

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


async def serve_until_stopped(
    app: FastAPI,
    listener: socket.socket,
    certificate: Path | None,
    key: Path | None,
    *,
    max_frame_bytes: int,
    max_waiting_frames: int = 32,
) -> None:
    """Serves an application until SIGTERM or SIGINT, with TLS where there is a certificate (PEM).

    Args:
        max_frame_bytes: of a WebSocket. max_waiting_frames: that are read before they are taken.
    """
    config = uvicorn.Config(
        app,
        log_level="warning",
        lifespan="on",
        ws_max_size=max_frame_bytes,
        ws_max_queue=max_waiting_frames,
        ssl_certfile=certificate,
        ssl_keyfile=key,
        timeout_graceful_shutdown=2,
    )
    server = uvicorn.Server(config)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: loop.call_soon_threadsafe(setattr, server, "should_exit", True))
    # not `serve`: it puts handlers of its own in the place of ours, and raises the signal again at last
    await server._serve(sockets=[listener])
