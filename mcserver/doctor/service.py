"""What the service needs besides: shared memory, a port to listen on, and a disk that syncs."""

from __future__ import annotations

import os
import shutil
import socket
import tempfile
import threading
import time
from pathlib import Path

import msgspec

from mcserver.doctor.finding import Finding, advice, good, missing

AREA = "service"
ZENOH_PORT = 7447
NEEDED_SHARED_MEMORY = 64 * 1024 * 1024
SYNCS = 10
# Longer than that is no answer [s]; what is above `SLOW_SYNC_S` shows in the server as MC524 when it is busy.
SYNC_LIMIT_S = 3.0
SLOW_SYNC_S = 0.25


class ServiceFacts(msgspec.Struct, frozen=True):
    """Free shared memory [bytes] (None: no ``/dev/shm``, or not writable), and Zenoh's usual port.

    ``port`` is ``free``, ``answers`` (somebody listens there already) or the operating system's refusal.
    ``sync_s`` is the longest of some syncs in the journals' folder [s]; None: nothing can be written there.
    """

    shared_memory: int | None
    port: str
    sync_s: float | None = None


def probe_service(journals: Path) -> ServiceFacts:
    """Look at ``/dev/shm``, at the loopback port, and at the disk of the journals' folder."""
    shared = "/dev/shm"
    writable = os.path.isdir(shared) and os.access(shared, os.W_OK)
    return ServiceFacts(
        shared_memory=shutil.disk_usage(shared).free if writable else None,
        port=_port_state(),
        sync_s=longest_sync_s(journals),
    )


def longest_sync_s(folder: Path) -> float | None:
    """Write a page and sync it, some times; return the longest [s], `SYNC_LIMIT_S` where it takes longer."""
    while not folder.exists() and folder != folder.parent:
        # nothing has run here yet: the folder will be made on the same disk
        folder = folder.parent
    taken: list[float] = []

    def write() -> None:
        try:
            with tempfile.TemporaryFile(dir=folder) as file:
                for _ in range(SYNCS):
                    start = time.monotonic()
                    file.write(bytes(4096))
                    file.flush()
                    os.fdatasync(file.fileno())
                    taken.append(time.monotonic() - start)
        except OSError:
            taken.clear()

    # a disk that hangs must not hang whoever asks about it
    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    thread.join(SYNC_LIMIT_S)
    return SYNC_LIMIT_S if thread.is_alive() else max(taken, default=None)


def _port_state() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.settimeout(0.5)
        if probe.connect_ex(("127.0.0.1", ZENOH_PORT)) == 0:
            return "answers"
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(("127.0.0.1", ZENOH_PORT))
        except OSError as error:
            return error.strerror or str(error)
    return "free"


def judge_service(facts: ServiceFacts) -> list[Finding]:
    """Findings about shared memory, the port and the disk."""
    return [_judge_memory(facts.shared_memory), _judge_port(facts.port), _judge_disk(facts.sync_s)]


def _judge_disk(sync_s: float | None) -> Finding:
    title = "disk of the journals"
    if sync_s is None:
        return advice(AREA, title, "the state folder cannot be written", "give another file with --journal")
    shown = f"a sync takes up to {1000.0 * sync_s:.0f} ms"
    if sync_s < SLOW_SYNC_S:
        return good(AREA, title, shown)
    fix = "keep journals on another disk (--journal), or find what keeps this one busy (iostat -x 1)"
    return advice(AREA, title, shown, fix)


def _judge_memory(free: int | None) -> Finding:
    title = "shared memory"
    if free is None:
        return missing(AREA, title, "/dev/shm is not there or not writable", "mount -t tmpfs tmpfs /dev/shm")
    shown = f"{free // 1024 // 1024} MiB free in /dev/shm"
    if free >= NEEDED_SHARED_MEMORY:
        return good(AREA, title, shown)
    return missing(AREA, title, shown, "mount -o remount,size=256m /dev/shm; in a container: --shm-size 256m")


def _judge_port(port: str) -> Finding:
    title = f"port {ZENOH_PORT}"
    if port == "free":
        return good(AREA, title, "free")
    if port == "answers":
        return good(AREA, title, "somebody listens there: a router or another server")
    return advice(
        AREA,
        title,
        f"cannot be listened on: {port}",
        "run with --listen tcp/127.0.0.1:7448, or another free port",
    )
