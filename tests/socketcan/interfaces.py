"""CAN interfaces of this computer, as their operator changes them (as root, as in the QEMU rig)."""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import shutil
import socket
import struct
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

from mcserver.can.port import CanPort, Frame
from mcserver.doctor.can import probe_can

BUSES = ("vcan0", "vcan1", "vcan2", "vcan3")
# linux/sockios.h, linux/if.h
SIOCGIFFLAGS = 0x8913
SIOCSIFFLAGS = 0x8914
IFF_UP = 1
IFREQ = struct.Struct("16sH22x")
# Limits of waits: an emulated machine on a busy computer is slow.
LIMIT_S = 30.0
COMMAND_LIMIT_S = 30.0
# `make socketcan` sets it: there a missing interface is a failure
REQUIRED = "MC_CAN_REQUIRED"


def lacking() -> str | None:
    """Why there is no SocketCAN here; None where there is."""
    if not probe_can().sockets:
        return "this kernel opens no CAN sockets"
    missing = [bus for bus in BUSES if not Path("/sys/class/net", bus).exists()]
    return f"there is no interface {', '.join(missing)}" if missing else None


def required() -> bool:
    return bool(os.environ.get(REQUIRED))


def set_up(interface: str, up: bool) -> None:
    """As ``ip link set INTERFACE up`` or ``down``."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        answer = fcntl.ioctl(control, SIOCGIFFLAGS, IFREQ.pack(interface.encode(), 0))
        flags = IFREQ.unpack(answer)[1]
        changed = flags | IFF_UP if up else flags & ~IFF_UP
        fcntl.ioctl(control, SIOCSIFFLAGS, IFREQ.pack(interface.encode(), changed))


@contextlib.contextmanager
def down(interface: str) -> Iterator[None]:
    """The interface is down inside the block."""
    set_up(interface, False)
    try:
        yield
    finally:
        set_up(interface, True)


@contextlib.contextmanager
def slow(interface: str) -> Iterator[None]:
    """The interface passes some hundred frames a second: a burst stays in its queue.

    A virtual interface has no queue of its own; a token bucket gives it one, as real controllers have.
    """
    tc = shutil.which("tc")
    assert tc is not None, "tc, of Debian's iproute2, is not installed"
    bucket = ["tbf", "rate", "64kbit", "burst", "256", "limit", "2048"]
    _call([tc, "qdisc", "add", "dev", interface, "root", *bucket])
    try:
        yield
    finally:
        _call([tc, "qdisc", "del", "dev", interface, "root"])


def _call(command: list[str]) -> None:
    ended = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, timeout=COMMAND_LIMIT_S, check=False
    )
    assert ended.returncode == 0, ended.stderr.decode()


def receive(port: CanPort, count: int) -> list[Frame]:
    """So many frames, or fewer where no more come."""
    return receive_until(port, lambda frames: len(frames) >= count)


def receive_until(port: CanPort, enough: Callable[[list[Frame]], bool]) -> list[Frame]:
    """What comes, until it is enough or nothing has come for a while."""
    frames = port.drain()
    while not enough(frames):
        if not select.select([port.fileno()], [], [], LIMIT_S)[0]:
            break
        frames += port.drain()
    return frames
