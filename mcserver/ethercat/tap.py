"""Frames of EtherCAT that pass a network interface, whoever sends them; nothing is sent."""

from __future__ import annotations

import socket
import time

from mcserver.errors import RuntimeFault

ETHERTYPE = 0x88A4
# Every frame, those that this computer sends too (linux/if_ether.h).
_EVERY = 0x0003
_HEADER = 14


def frames_heard(interface: str, duration_s: float) -> int:
    """Count the frames that pass within a time; the first ones end it.

    Raises:
        RuntimeFault: MC424 the interface cannot be listened on.
    """
    try:
        with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_EVERY)) as tap:
            tap.bind((interface, _EVERY))
            deadline = time.monotonic() + duration_s
            heard = 0
            while not heard and (left := deadline - time.monotonic()) > 0.0:
                tap.settimeout(left)
                try:
                    frame = tap.recv(_HEADER)
                except TimeoutError:
                    break
                heard += frame[12:14] == ETHERTYPE.to_bytes(2, "big")
            return heard
    except OSError as error:
        raise RuntimeFault(
            "MC424",
            f"the interface {interface} cannot be listened on: {error.strerror or error}",
            "`ip link` lists interfaces; raw sockets need root or CAP_NET_RAW",
        ) from error


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
