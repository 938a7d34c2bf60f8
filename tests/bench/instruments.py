"""What the field's instruments cost beside a machine: late cycles, and processor time of their processes.

At last with garbage and requests at all doors at once, as fast as a process for each sends them; the control
has the same processor load in as many processes, and no instrument.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import sys
import threading
import time
import urllib.request
from collections.abc import Callable
from contextlib import ExitStack, suppress

from websockets.sync.client import connect

from tests.bench.figures import Figure, NotAvailable
from tests.bench.recorder import late_cycles
from tests.bench.server import free_port, running, server
from tests.bench.telemetry import cpu_seconds, cpu_share

# until a process has imported all and reached the machine, and how long until it is read at most [s]
SETTLE_S, SERVED_S = 20.0, 180.0

DOORS = ("opcua", "mtconnect", "web", "gateway")

# reads an address while the function that it is given says so
Reader = Callable[[str, Callable[[], bool]], None]


def measure() -> list[Figure]:
    """Each instrument in turn, read as people read it, beside one server of 12 axes."""
    if shutil.which("mosquitto") is None:
        raise NotAvailable("mosquitto is not installed")
    port = str(free_port())
    at = ["--port", port]
    instruments: dict[str, tuple[list[str], str, Reader | None]] = {
        "opcua": (["opcua", *at], "", None),
        "mtconnect, streaming": (["mtconnect", *at], f"http://127.0.0.1:{port}/sample?interval=100", stream),
        "mqtt": (["mqtt", f"mqtt://127.0.0.1:{port}"], "", None),
        "ros": (["ros"], "", None),
        "prometheus, each second": (["web", *at], f"http://127.0.0.1:{port}/metrics", scrape),
        "foxglove, all channels": (["gateway", *at], f"ws://127.0.0.1:{port}/v1/foxglove/bench", view),
    }
    found = []
    with server() as reached:
        for name, (words, url, read) in instruments.items():
            alone = late_cycles(reached.endpoint)
            with ExitStack() as stack:
                if words[0] == "mqtt":
                    stack.enter_context(running(["mosquitto", "-p", port]))
                command = [sys.executable, "-m", "mcserver", *words, "--connect", reached.endpoint]
                process = stack.enter_context(running(command))
                if read is not None:
                    reading = Reading(read, url)
                    stack.callback(reading.close)
                    reading.until_served(SERVED_S)
                time.sleep(SETTLE_S)
                share = cpu_share(process.pid)
                beside = late_cycles(reached.endpoint)
                if process.poll() is not None:
                    raise NotAvailable(f"mcserver {words[0]} ended with {process.returncode}")
            found.append(Figure(f"{name}: its process", share, "% of a core"))
            found.append(Figure("late cycles beside it", beside, "in 10 000", alone, "without it", "no more"))
    return [*found, *attacked()]


def attacked() -> list[Figure]:
    """All doors at once, attacked; then the same load without instruments."""
    python = [sys.executable, "-c"]
    with server() as reached:
        alone = many_late_cycles(reached.endpoint)
        with ExitStack() as stack:
            ports = [free_port() for _ in DOORS]
            processes = [
                stack.enter_context(
                    running(
                        [
                            sys.executable,
                            "-m",
                            "mcserver",
                            door,
                            "--port",
                            str(port),
                            "--connect",
                            reached.endpoint,
                        ]
                    )
                )
                for door, port in zip(DOORS, ports, strict=True)
            ]
            for port in ports:
                await_door(port)
            for port in ports:
                command = f"from tests.bench.instruments import attack; attack({port})"
                processes.append(stack.enter_context(running([*python, command])))
            time.sleep(SETTLE_S)
            before, start = [cpu_seconds(each.pid) for each in processes], time.perf_counter()
            beside = many_late_cycles(reached.endpoint)
            passed = time.perf_counter() - start
            shares = [
                (cpu_seconds(each.pid) - spent) / passed
                for each, spent in zip(processes, before, strict=True)
            ]
            if any(each.poll() is not None for each in processes):
                raise NotAvailable("a door ended under attack")
        with ExitStack() as stack:
            for share in shares:
                command = f"from tests.bench.instruments import burn; burn({share})"
                stack.enter_context(running([*python, command]))
            time.sleep(SETTLE_S)
            control = many_late_cycles(reached.endpoint)
    load = 100.0 * sum(shares)
    return [
        Figure("all doors attacked: their processes and the attackers", load, "% of a core"),
        Figure("late cycles beside them", beside, "in 60 000", control, "the same load alone", "no more"),
        Figure("late cycles without any load", alone, "in 60 000"),
    ]


def many_late_cycles(endpoint: str) -> float:
    """Late cycles in 60 000."""
    return sum(late_cycles(endpoint) for _ in range(6))


def await_door(port: int) -> None:
    """Return once somebody listens there. Raises NotAvailable where nobody does."""
    until = time.monotonic() + SERVED_S
    while time.monotonic() < until:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
            return
        time.sleep(0.2)
    raise NotAvailable(f"nobody listens on {port}")


def attack(port: int) -> None:
    """Send garbage and requests to a port, until the process is ended."""
    head = b" HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    paths = (b"/metrics", b"/sample?count=100", b"/probe", b"/v1/machines", b"/machine/bench", b"/nosuch")
    inputs = [
        os.urandom(200),
        b"\x00garbage\r\n\r\n",
        b"HELF" + bytes(60),
        *(b"GET " + path + head for path in paths),
    ]
    while True:
        for each in inputs:
            with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0) as connection:
                connection.settimeout(0.02)
                connection.sendall(each)
                connection.recv(65536)


def burn(share: float) -> None:
    """Take a share of a core, ten milliseconds at a time, until the process is ended."""
    while True:
        until = time.process_time() + 0.01 * share
        while time.process_time() < until:
            pass
        time.sleep(0.01 * max(0.0, 1.0 - share))


class Reading:
    """A thread that reads an address, and begins again where it was not served yet."""

    def __init__(self, read: Reader, url: str) -> None:
        self._ended = threading.Event()
        self._served = threading.Event()
        self._read, self._url = read, url
        self._thread = threading.Thread(target=self._again, daemon=True)
        self._thread.start()

    def goes_on(self) -> bool:
        """Note that something has arrived; return whether more is wanted."""
        self._served.set()
        return not self._ended.is_set()

    def until_served(self, limit_s: float) -> None:
        """Return once something has arrived. Raises NotAvailable where nothing does."""
        if not self._served.wait(limit_s):
            raise NotAvailable(f"{self._url} was not served")

    def close(self) -> None:
        """End it."""
        self._ended.set()

    def _again(self) -> None:
        while not self._ended.wait(0.2):
            with suppress(Exception):
                self._read(self._url, self.goes_on)


def stream(url: str, goes_on: Callable[[], bool]) -> None:
    """Read an answer that does not end."""
    with urllib.request.urlopen(url, timeout=5.0) as answer:
        while answer.read1(65536) and goes_on():
            pass


def scrape(url: str, goes_on: Callable[[], bool]) -> None:
    """Ask once a second."""
    while True:
        with urllib.request.urlopen(url, timeout=5.0) as answer:
            answer.read()
        if not goes_on():
            return
        time.sleep(1.0)


def view(url: str, goes_on: Callable[[], bool]) -> None:
    """Subscribe to every channel of Foxglove's WebSocket."""
    with connect(url, subprotocols=["foxglove.sdk.v1"]) as socket:  # type: ignore[list-item]
        socket.recv(5.0)
        offered = json.loads(socket.recv(5.0))["channels"]
        wanted = [{"id": each["id"], "channelId": each["id"]} for each in offered]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        while socket.recv(5.0) and goes_on():
            pass
