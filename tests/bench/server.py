"""A server in a process of its own, and a plain Zenoh session to it."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import zenoh

from tests.bench.figures import NotAvailable
from tests.e2e.servers import ROOT, START_LIMIT_S, ServerProcess, environment

# on a computer that is busy with other work
STOP_LIMIT_S = 60.0


@dataclass(frozen=True)
class Server:
    """What a client needs to reach it."""

    process: ServerProcess
    session: zenoh.Session

    @property
    def endpoint(self) -> str:
        return self.process.endpoint

    @property
    def machine(self) -> str:
        return self.process.name

    def ask(self, method: str, **request: Any) -> dict[str, Any]:
        """One remote call; the reply as a map."""
        key = f"mc/@v1/{self.machine}/{method}"
        for reply in self.session.get(key, payload=msgspec.msgpack.encode(request), timeout=5.0):
            if reply.ok is not None:
                answer: dict[str, Any] = msgspec.msgpack.decode(reply.ok.payload.to_bytes())
                return answer
            raise NotAvailable(f"{method} is refused: {msgspec.msgpack.decode(reply.err.payload.to_bytes())}")
        return {}


@contextmanager
def server(machine_file: str = "", *, recorder: bool = True) -> Iterator[Server]:
    """``mcserver run`` on a free loopback port, with a journal that goes with it."""
    with TemporaryDirectory() as folder:
        machine = "cartesian"
        if machine_file:
            machine = str(Path(folder, "machine.toml"))
            Path(machine).write_text(machine_file, "utf-8")
        process = ServerProcess(Path(folder), machine, "bench", recorder=recorder)
        try:
            process.start()
            with zenoh.open(client_config(process.endpoint)) as session:
                yield Server(process, session)
        finally:
            process.close()


@contextmanager
def companion(*command: str) -> Iterator[subprocess.Popen[str]]:
    """``python -m command``, which says in a line that it is ready, and ends once its input closes.

    Raises:
        NotAvailable: it says anything else.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        said = process.stdout.readline().strip()
        if said != "ready":
            raise NotAvailable(f"{' '.join(command)} is not ready: {said}")
        yield process
    finally:
        if not process.stdout.closed:
            process.communicate(timeout=30)


@contextmanager
def running(command: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """A process that nobody listens to; it ends with the block."""
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=ROOT, env=environment()
    )
    try:
        yield process
    finally:
        end(process)


def end(process: subprocess.Popen[Any]) -> None:
    """End a process in order; kill it where it takes too long, which must not hide what was measured."""
    process.terminate()
    try:
        process.wait(STOP_LIMIT_S)
    except subprocess.TimeoutExpired:
        print(f"  process {process.pid} had to be killed", file=sys.stderr)
        process.kill()
        process.wait()


def client_config(endpoint: str) -> zenoh.Config:
    """A client that knows one endpoint and tries it again and again."""
    config = zenoh.Config()
    settings = {
        "mode": '"client"',
        "connect/endpoints": f'["{endpoint}"]',
        "connect/timeout_ms": f"{1000 * START_LIMIT_S:.0f}",
        "scouting/multicast/enabled": "false",
    }
    for key, value in settings.items():
        config.insert_json5(key, value)
    return config


def free_port() -> int:
    """A loopback port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
