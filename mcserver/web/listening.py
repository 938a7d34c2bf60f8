"""A listening socket for a page or a gateway."""

from __future__ import annotations

import socket

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
