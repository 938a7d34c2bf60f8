"""What the field's instruments cost beside a machine: late cycles, and processor time of their processes."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress

from websockets.sync.client import connect

from tests.bench.figures import Figure, NotAvailable
from tests.bench.recorder import late_cycles
from tests.bench.server import end, free_port, server
from tests.bench.telemetry import cpu_share

# until a process has imported all and reached the machine, and how long until it is read at most [s]
SETTLE_S, SERVED_S = 20.0, 180.0

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
    return found


@contextmanager
def running(command: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """A process that ends with the block."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        end(process)


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
