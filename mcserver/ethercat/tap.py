"""Frames of EtherCAT that pass a network interface, whoever sends them; nothing is sent."""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence
from contextlib import suppress

from mcserver.errors import RuntimeFault

ETHERTYPE = 0x88A4
# Every frame, those that this computer sends too (linux/if_ether.h).
_EVERY = 0x0003
_HEADER = 14


def open_tap(interfaces: Sequence[str]) -> socket.socket:
    """Return a socket that hears every frame, of all interfaces where several are named, and never waits.

    Raises:
        RuntimeFault: MC424 it cannot be listened.
    """
    one = len(interfaces) == 1
    try:
        # with its protocol it hears all interfaces before it is bound to one
        tap = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0 if one else socket.htons(_EVERY))
        try:
            tap.setblocking(False)
            if one:
                tap.bind((interfaces[0], _EVERY))
        except OSError:
            tap.close()
            raise
    except OSError as error:
        raise RuntimeFault(
            "MC424",
            f"the interface {' or '.join(interfaces)} cannot be listened on: {error.strerror or error}",
            "`ip link` lists interfaces; raw sockets need root or CAP_NET_RAW",
        ) from error
    return tap


def frames_heard(interface: str, duration_s: float) -> int:
    """Count the frames that pass within a time; the first ones end it.

    Raises:
        RuntimeFault: MC424 the interface cannot be listened on.
    """
    deadline = time.monotonic() + duration_s
    heard = 0
    with open_tap([interface]) as tap:
        while not heard and (left := deadline - time.monotonic()) > 0.0:
            tap.settimeout(left)
            with suppress(OSError):
                heard += tap.recv(_HEADER)[12:14] == ETHERTYPE.to_bytes(2, "big")
    return heard


def refuse_other_master(interface: str, name: str, duration_s: float) -> None:
    """Listen before the first frame is sent: the slaves of a line at work must not be reset.

    Raises:
        RuntimeFault: MC560 frames pass, MC424 as `frames_heard`.
    """
    if frames_heard(interface, duration_s):
        raise RuntimeFault(
            "MC560",
            f"{name}: another master is at work: frames of EtherCAT pass {interface}",
            "stop the server or the other master first",
        )
