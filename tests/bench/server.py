"""A server in a process of its own, and a plain Zenoh session to it."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import zenoh

from tests.bench.figures import NotAvailable

# on a computer that is busy with other work
START_LIMIT_S = 180.0
STOP_LIMIT_S = 60.0


@dataclass(frozen=True)
class Server:
    """What a client needs to reach it."""

    process: subprocess.Popen[bytes]
    endpoint: str
    machine: str
    session: zenoh.Session
    journal: Path

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
def server(machine_file: str = "", name: str = "bench") -> Iterator[Server]:
    """``mcserver run`` on a free loopback port, with a journal that goes with it."""
    with TemporaryDirectory() as folder:
        machine = "cartesian"
        if machine_file:
            machine = str(Path(folder, "machine.toml"))
            Path(machine).write_text(machine_file, "utf-8")
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        command = "from mcserver.cli.app import main; main()"
        options = [
            "--machine",
            machine,
            "--name",
            name,
            "--listen",
            endpoint,
            "--journal",
            f"{folder}/journal.db",
        ]
        process = subprocess.Popen(
            [sys.executable, "-c", command, "run", *options], stderr=subprocess.DEVNULL
        )
        try:
            session = zenoh.open(client_config(endpoint))
            reached = Server(process, endpoint, name, session, Path(folder, "journal.db"))
            await_answer(reached)
            yield reached
            session.close()
        finally:
            end(process)


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


def end(process: subprocess.Popen[Any]) -> None:
    """End a process in order; kill it where it takes too long, which must not hide what was measured."""
    process.terminate()
    try:
        process.wait(STOP_LIMIT_S)
    except subprocess.TimeoutExpired:
        print(f"  process {process.pid} had to be killed", file=sys.stderr)
        process.kill()
        process.wait()


def await_answer(reached: Server) -> None:
    """Until the server answers.

    Raises:
        NotAvailable: it ended, or does not answer in time.
    """
    until = time.monotonic() + START_LIMIT_S
    while time.monotonic() < until:
        if reached.process.poll() is not None:
            raise NotAvailable(f"mcserver run ended with {reached.process.returncode}")
        if reached.ask("info"):
            return
        time.sleep(0.05)
    raise NotAvailable(f"mcserver run does not answer within {START_LIMIT_S:.0f} s")


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
