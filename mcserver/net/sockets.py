"""Find and shut down sockets of this process, whichever library opened them."""

from __future__ import annotations

import contextlib
import os
import socket
import stat
from collections.abc import Collection


def port_of(locator: str) -> str:
    """Return the port of a Zenoh locator, such as ``tcp/127.0.0.1:7447``."""
    return locator.partition("?")[0].partition("#")[0].rpartition(":")[2]


def shut_down(ports: Collection[str]) -> None:
    """Shut down connections with one of these local ports, so that the other sides notice."""
    for number in map(int, os.listdir("/proc/self/fd")):
        with contextlib.suppress(OSError):
            # wrapping a descriptor that is not a socket would leave its copy open
            if not stat.S_ISSOCK(os.fstat(number).st_mode):
                continue
            with socket.socket(fileno=os.dup(number)) as found:
                if found.family in (socket.AF_INET, socket.AF_INET6) and str(found.getsockname()[1]) in ports:
                    found.shutdown(socket.SHUT_RDWR)
