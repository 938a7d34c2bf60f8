"""Two network namespaces with a bad link between them: late, lossy, out of order, stalled or cut.

The link is a TUN device at each end and a thread that carries the packets, so it needs root and /dev/net/tun
and nothing of the kernel's traffic control.
"""

from __future__ import annotations

import contextlib
import fcntl
import heapq
import itertools
import os
import random
import select
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec

from tests.network_namespace import entered

SERVER_ADDRESS, CLIENT_ADDRESS = "10.98.7.1", "10.98.7.2"
_TUNSETIFF = 0x400454CA
_IFF_TUN_NO_PI = 0x0001 | 0x1000
_PACKET = 65536
# of packets under way in one direction: beyond it they are lost, as in any queue
_QUEUE = 2000


class Weather(msgspec.Struct, frozen=True):
    """What happens to each packet.

    Attributes:
        loss, double: shares of packets. delay_s: each is late by up to this; so they overtake each other.
        stalled: none passes now, and all do later. cut: none passes, now or later.
    """

    loss: float = 0.0
    double: float = 0.0
    delay_s: float = 0.0
    stalled: bool = False
    cut: bool = False


class MissingMeans(Exception):
    """What this computer lacks for such a link."""


class BadLink:
    """Carries packets between two namespaces until `close`.

    Args:
        seed: of what happens to packets.

    Attributes:
        weather: in force; may be set at any time. carried, lost: packets so far.
    """

    def __init__(self, seed: int) -> None:
        self.weather = Weather()
        self.carried = 0
        self.lost = 0
        self.names = [f"mcfire{os.getpid()}-{seed % 1000}-{end}" for end in ("s", "c")]
        self._draw = random.Random(seed)
        self._ending = threading.Event()
        self._ends: list[int] = []
        try:
            for name, address in zip(self.names, (SERVER_ADDRESS, CLIENT_ADDRESS), strict=True):
                _run("ip", "netns", "add", name)
                self._ends.append(_tun_in(name))
                inside = ("ip", "-n", name)
                _run(*inside, "link", "set", "lo", "up")
                _run(*inside, "address", "add", f"{address}/24", "dev", "bad0")
                _run(*inside, "link", "set", "bad0", "up")
        except BaseException:
            self._remove()
            raise
        self._thread = threading.Thread(target=self._carry, name="bad-link", daemon=True)
        self._thread.start()

    def inside(self, end: int) -> list[str]:
        """What a command is prefixed with to run at the server's end, 0, or at the client's, 1."""
        return ["ip", "netns", "exec", self.names[end]]

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._remove()

    def _remove(self) -> None:
        for end in self._ends:
            os.close(end)
        for name in self.names:
            subprocess.run(["ip", "netns", "delete", name], check=False, capture_output=True)

    def _carry(self) -> None:
        due: list[tuple[float, int, int, bytes]] = []
        number = itertools.count()
        while not self._ending.is_set():
            now = time.monotonic()
            weather = self.weather
            wait = 0.02 if not due or weather.stalled else min(0.02, max(0.0, due[0][0] - now))
            for end in select.select(self._ends, [], [], wait)[0]:
                packet = os.read(end, _PACKET)
                other = self._ends[1 - self._ends.index(end)]
                copies = 0 if weather.cut or self._draw.random() < weather.loss else 1
                copies += copies and self._draw.random() < weather.double
                self.lost += not copies
                for _ in range(copies):
                    if len(due) < _QUEUE:
                        late = now + self._draw.random() * weather.delay_s
                        heapq.heappush(due, (late, next(number), other, packet))
            while due and not self.weather.stalled and due[0][0] <= time.monotonic():
                _, _, other, packet = heapq.heappop(due)
                self.carried += 1
                # a namespace that is going takes no more
                with contextlib.suppress(OSError):
                    os.write(other, packet)


@contextlib.contextmanager
def bad_link(seed: int) -> Iterator[BadLink]:
    """A link that goes with the block.

    Raises:
        MissingMeans: no root, no TUN devices, or no namespaces here.
    """
    if os.geteuid() != 0:
        raise MissingMeans("network namespaces need root")
    if not Path("/dev/net/tun").exists():
        raise MissingMeans("there is no /dev/net/tun")
    try:
        link = BadLink(seed)
    except (OSError, subprocess.CalledProcessError) as error:
        raise MissingMeans(f"no namespace with a TUN device: {error}") from error
    try:
        yield link
    finally:
        link.close()


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)


def _tun_in(namespace: str) -> int:
    """A TUN device ``bad0`` in a namespace; its descriptor can be used from anywhere."""
    with entered(namespace):
        device = os.open("/dev/net/tun", os.O_RDWR | os.O_CLOEXEC)
        fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH22x", b"bad0", _IFF_TUN_NO_PI))
    return device
