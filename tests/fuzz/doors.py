"""Raw bytes at the HTTP and WebSocket ports of `mcserver gateway` and `mcserver web`, beside a program.

``make fuzz ARGS="--target gateway"`` and ``--target page``: the inputs and the judge are those of
`tests.fuzz.port`, with requests and frames of real clients. The door has to answer between the inputs, to
keep its memory within bounds and to say nothing of a fault of its own; at last hold, abort and emergency
stop have to come through it, or, of the page, through the server beside it.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import random
import re
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from tests.e2e.servers import CommandProcess
from tests.fuzz.port import ANSWER_S, FAILURES, Inputs, Machine, judged, machine

# what it may grow by while it is attacked [MiB]
MOST_GROWTH_MIB = 300.0
# of libraries below the door, beside `FAILURES`
DOOR_FAILURES = (*FAILURES, "Exception in ASGI", "never retrieved", "never awaited")
GATEWAY_POSTS = (
    ("check", {"text": "G01 X1 F100"}),
    ("submit", {"program": "p-1", "first": 1, "lines": ["G01 X1"]}),
    ("jog", {"axis": 99, "distance": 1.0}),
    ("nosuch", {}),
)
FRAMES: tuple[dict[str, Any], ...] = (
    {"op": "machines", "id": 1},
    {"op": "call", "id": 2, "machine": "cell", "method": "status", "params": {}, "request": None},
    {"op": "subscribe", "id": 3, "machine": "cell", "topic": "state"},
    {"op": "targets", "machine": "cell", "program": "p-1", "message": [1, 0.0, 0.1, [[1.0]], None, None]},
    {"op": "unsubscribe", "id": 3},
)


class Door:
    """A gateway or a page, as a process of its own, whose log is kept.

    Args:
        command: ``gateway`` or ``web``.
    """

    def __init__(self, command: str, endpoint: str, folder: Path) -> None:
        self.log = folder / "door.log"
        options = ("--programs", str(folder)) if command == "web" else ()
        with self.log.open("w") as log:
            self.process = CommandProcess(command, "--port", "0", "--connect", endpoint, *options, errors=log)
        self.address = ("127.0.0.1", int(self.process.url.rstrip("/").rpartition(":")[2]))
        self.name = command
        self.longest_s = 0.0
        self.begun_mib = self.mib

    @property
    def mib(self) -> float:
        """Resident memory [MiB]."""
        status = Path(f"/proc/{self.process.process.pid}/status").read_text()
        found = re.search(r"VmRSS:\s+(\d+) kB", status)
        return 0.0 if found is None else int(found[1]) / 1024.0

    def ask(self, path: str, body: object = None) -> bytes:
        """Return an answer's body.

        Raises:
            OSError, HTTPException: none came. ValueError: it is a refusal.
        """
        asked = time.monotonic()
        connection = http.client.HTTPConnection(*self.address, timeout=6 * ANSWER_S)
        with contextlib.closing(connection):
            method, data = ("GET", None) if body is None else ("POST", json.dumps(body))
            connection.request(method, path, data, {"Content-Type": "application/json"})
            answer = connection.getresponse()
            content = answer.read()
        self.longest_s = max(self.longest_s, time.monotonic() - asked)
        if answer.status != 200:
            raise ValueError(f"{path} was answered {answer.status}: {content[:300]!r}")
        return content

    def wrong(self) -> str:
        """What is wrong with it; empty: nothing."""
        try:
            self.ask("/v1/machines/cell/status" if self.name == "gateway" else "/machine/cell")
        except (OSError, http.client.HTTPException, ValueError) as error:
            return f"the {self.name} does not answer: {error!r}\n{self.log.read_text()[-3000:]}"
        said = self.log.read_text()
        at = min((said.find(word) for word in DOOR_FAILURES if word in said), default=-1)
        if at >= 0:
            return f"the {self.name} said:\n{said[max(0, at - 500) : at + 20_000]}"
        if self.mib > self.begun_mib + MOST_GROWTH_MIB:
            return f"the {self.name} has grown from {self.begun_mib:.0f} to {self.mib:.0f} MiB"
        return ""

    def stops(self, watched: Machine) -> str:
        """Hold, abort and stop a program; what did not come through, empty: all did."""
        program = watched.ask("open", axes=[1], on_disconnect="finish")["program"]
        watched.ask("submit", program=program, first=1, lines=["G1010 P1", "G01 Y100 F60"])
        order: Callable[[str, dict[str, Any]], object] = partial(_by_http, self)
        if self.name != "gateway":
            order = lambda method, fields: watched.ask(method, **fields)  # noqa: E731
        for method, fields, wanted in (
            ("hold", {"program": program}, "held"),
            ("abort", {"program": program}, "aborted"),
        ):
            order(method, fields)
            if not _reached(watched, program, wanted):
                return f"{method} did not come through"
        order("estop", {"reason": "fuzz"})
        until = time.monotonic() + ANSWER_S
        while watched.ask("status")["state"] != "estop":
            if time.monotonic() > until:
                return "the emergency stop did not come through"
        return ""


def _by_http(door: Door, method: str, fields: dict[str, Any]) -> bytes:
    return door.ask(f"/v1/machines/cell/{method}", fields)


def _reached(watched: Machine, program: str, state: str) -> bool:
    until = time.monotonic() + ANSWER_S
    while time.monotonic() < until:
        (found,) = watched.ask("programs", program=program, ended=True)["programs"]
        if found["state"] == state:
            return True
    return False


# ------------------------------------------------------------------ what clients say


def _address(endpoint: str) -> tuple[str, int]:
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    return host, int(port)


def _requests(endpoint: str, requests: list[tuple[str, bytes | None, str]]) -> None:
    """Send requests over one connection, as far as it takes them."""
    connection = http.client.HTTPConnection(*_address(endpoint), timeout=1.0)
    with contextlib.suppress(OSError, http.client.HTTPException), contextlib.closing(connection):
        for path, body, kind in requests:
            connection.request("GET" if body is None else "POST", path, body, {"Content-Type": kind})
            connection.getresponse().read()


def gateway_calls(endpoint: str) -> None:
    """A script at the gateway."""
    posts = [
        (f"/v1/machines/cell/{method}", json.dumps(fields).encode(), "application/json")
        for method, fields in GATEWAY_POSTS
    ]
    _requests(endpoint, [("/v1/machines", None, ""), ("/v1/machines/cell/status", None, ""), *posts])


def gateway_frames(endpoint: str) -> None:
    """A browser at the gateway."""
    host, port = _address(endpoint)
    with (
        contextlib.suppress(OSError, WebSocketException, EOFError),
        connect(
            f"ws://{host}:{port}/v1/ws",
            subprotocols=[Subprotocol("mc.v1")],
            open_timeout=1.0,
            close_timeout=0.2,
        ) as socket,
    ):
        for frame in FRAMES:
            socket.send(msgspec.msgpack.encode(frame))
            socket.recv(timeout=0.3)


def page_requests(endpoint: str) -> None:
    """A browser that loads the page and logs in."""
    form = "application/x-www-form-urlencoded"
    _requests(
        endpoint,
        [
            ("/login?then=/machine/cell", None, ""),
            ("/login", b"name=ada&password=horse&then=/machine/cell", form),
            ("/machine/cell", None, ""),
            ("/metrics", None, ""),
            ("/_nicegui_ws/socket.io/?EIO=4&transport=polling", None, ""),
        ],
    )


def page_events(page: tuple[str, int], endpoint: str) -> None:
    """The scripts of a page that is open: its handshake, an event of a button, a message of their own.

    Args:
        page: where the page is loaded from, beside the connection that is looked at.
    """
    host, port = _address(endpoint)
    with contextlib.suppress(OSError, http.client.HTTPException, WebSocketException, EOFError):
        connection = http.client.HTTPConnection(*page, timeout=2.0)
        with contextlib.closing(connection):
            connection.request("GET", "/machine/cell")
            text = connection.getresponse().read().decode("utf-8", "replace")
        found = re.search(r"client_id['\"]?\s*:\s*['\"]([0-9a-f-]{36})", text)
        client = found[1] if found else "0"
        hello = {"client_id": client, "document_id": "1", "tab_id": "1", "next_message_id": 0}
        event = {"id": 10, "client_id": client, "listener_id": "1", "args": []}
        address = f"ws://{host}:{port}/_nicegui_ws/socket.io/?EIO=4&transport=websocket&client_id={client}"
        with connect(address, open_timeout=1.0, close_timeout=0.2) as socket:
            for frame in (
                "40",
                f"420{json.dumps(['handshake', hello])}",
                f"42{json.dumps(['event', event])}",
            ):
                socket.send(frame)
                socket.recv(timeout=0.3)


def long_request(draw: random.Random, said: bytes) -> bytes:
    """The head of a body, a chunk or a frame that is longer than what comes."""
    head = b"POST /v1/machines/cell/check HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    upgrade = (
        b"GET /v1/ws HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        b"Sec-WebSocket-Protocol: mc.v1\r\n\r\n"
    )
    return draw.choice(
        (
            head + b"Content-Length: 999999999999\r\n\r\n" + said,
            head + b"Content-Length: -1\r\n\r\n" + said,
            head + b"Transfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n" + said,
            head + b"X: " + b"x" * draw.randrange(100_000),
            upgrade + b"\x82\xff\x7f\xff\xff\xff\xff\xff\xff\xff" + said,
            upgrade + b"\x02\x80\x00\x00\x00\x00" * draw.randrange(5000),
        )
    )


def run(name: str, seconds: float, inputs: int, seed: int) -> int:
    """Send inputs to a door for a time, or so many; the exit code: 1 where something was found."""
    with machine() as watched, tempfile.TemporaryDirectory() as folder:
        door = Door("web" if name == "page" else name, watched.server.endpoint, Path(folder))
        talks: tuple[Callable[[str], None], ...] = (gateway_calls, gateway_frames)
        if name == "page":
            talks = (page_requests, partial(page_events, door.address))
        try:
            _until_it_knows_the_machine(door)
            sent = Inputs(door.address, seed, in_session=True, talks=talks, long=long_request)
            found = judged(name, watched, sent, lambda: watched.look() or door.wrong(), seconds, inputs, seed)
            wrong = "" if found else door.stops(watched)
            came = wrong or "hold, abort and stop came through"
            print(
                f"{'':10} the {name} answered within {door.longest_s:.1f} s and grew from"
                f" {door.begun_mib:.0f} to {door.mib:.0f} MiB; {came}",
                flush=True,
            )
        finally:
            door.process.close()
    return 1 if found or wrong else 0


def _until_it_knows_the_machine(door: Door) -> None:
    until = time.monotonic() + 12 * ANSWER_S
    while door.wrong():
        if time.monotonic() > until:
            raise TimeoutError(door.wrong())
        time.sleep(0.2)
