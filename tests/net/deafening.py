"""A stranger whose malformed declaration makes Zenoh 1.10.2 panic with its routing tables locked."""

from __future__ import annotations

import asyncio
import contextlib
import queue
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import zenoh

from tests.zenoh_sessions import opened

# a subscriber on "mc/@v1/…/tele" and this: Zenoh takes the key apart before it has looked at it
KEY_END, MALFORMED = b"\x03/**", b"\x03**-"
LIMIT_S = 5.0


def stranger(endpoint: str) -> zenoh.Session:
    """A plain client session."""
    timeout_ms = int(1000 * LIMIT_S)
    return opened({"mode": "client", "connect/endpoints": [endpoint], "connect/timeout_ms": timeout_ms})


def deafen(
    endpoint: str,
    machine: str,
    tls: ssl.SSLContext | None = None,
    visit: Callable[[str], zenoh.Session] = stranger,
) -> None:
    """Make the session that listens at ``endpoint`` deaf for good.

    Args:
        tls: of the connection that the malformed key goes by. visit: opens the session that meets the key.
    """
    key = f"mc/@v1/{machine}/tele"
    with _malforming(endpoint, tls) as way, stranger(way) as one, visit(endpoint) as other:
        one.declare_subscriber(f"{key}/**", lambda _: None)
        # known to the server before it goes
        list(one.get(f"mc/@v1/{machine}/info", timeout=LIMIT_S))
        # whoever comes by the malformed key makes Zenoh panic
        other.declare_subscriber(f"{key}/*", lambda _: None)
        list(other.get(f"mc/@v1/{machine}/info", timeout=0.3))


@contextmanager
def _malforming(endpoint: str, tls: ssl.SSLContext | None) -> Iterator[str]:
    """A way to the endpoint, on which a declared key is changed.

    Raises:
        AssertionError: none was.
    """
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    ways: queue.SimpleQueue[str] = queue.SimpleQueue()
    loop = asyncio.new_event_loop()
    ended = asyncio.Event()
    changed: list[bytes] = []

    async def carry(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError), contextlib.closing(sink):
            while piece := await source.read(65536):
                if KEY_END in piece:
                    changed.append(piece)
                sink.write(piece.replace(KEY_END, MALFORMED))

    async def pass_on(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        with contextlib.closing(sink):
            theirs, ours = await asyncio.open_connection(host, int(port), ssl=tls)
            await asyncio.gather(carry(source, ours), carry(theirs, sink))

    async def relay() -> None:
        async with await asyncio.start_server(pass_on, "127.0.0.1", 0) as listener:
            ways.put(f"tcp/127.0.0.1:{listener.sockets[0].getsockname()[1]}")
            await ended.wait()

    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        thread = threading.Thread(target=runner.run, args=(relay(),))
        thread.start()
        try:
            yield ways.get(timeout=LIMIT_S)
        finally:
            loop.call_soon_threadsafe(ended.set)
            thread.join()
    assert changed, "no key was changed on the way"
