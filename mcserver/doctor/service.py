"""What the service needs besides: shared memory and a port to listen on."""

from __future__ import annotations

import os
import shutil
import socket

import msgspec

from mcserver.doctor.finding import Finding, advice, good, missing

AREA = "service"
ZENOH_PORT = 7447
NEEDED_SHARED_MEMORY = 64 * 1024 * 1024


class ServiceFacts(msgspec.Struct, frozen=True):
    """Free shared memory [bytes] (None: no ``/dev/shm``, or not writable), and Zenoh's usual port.

    ``port`` is ``free``, ``answers`` (somebody listens there already) or the operating system's refusal.
    """

    shared_memory: int | None
    port: str


def probe_service() -> ServiceFacts:
    """Look at ``/dev/shm`` and at the loopback port."""
    shared = "/dev/shm"
    writable = os.path.isdir(shared) and os.access(shared, os.W_OK)
    return ServiceFacts(
        shared_memory=shutil.disk_usage(shared).free if writable else None, port=_port_state()
    )


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
    """Findings about shared memory and the port."""
    return [_judge_memory(facts.shared_memory), _judge_port(facts.port)]


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
