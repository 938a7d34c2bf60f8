"""``mcserver run`` as a process of its own, watched and ended from outside."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import re
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parents[2]
# in an emulated machine a server takes a minute to start
START_LIMIT_S = 300.0
STOP_LIMIT_S = 20.0
READY = re.compile(r"ready, .* listening on ([^\s,]+)")
EXECUTOR = "mcserver.executor.process"
PLANNER = "mcserver.planning.process"


def environment() -> dict[str, str]:
    """For the project's commands: its packages are those of this tree, and no line of output is wrapped."""
    paths = [str(ROOT), str(ROOT / "kinematics"), str(ROOT / "clients" / "python")]
    kept = {key: value for key, value in os.environ.items() if key not in ("MC_CONNECT", "MC_MACHINE")}
    return {**kept, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "400", "NO_COLOR": "1"}


class ServerProcess:
    """One start of the server after another, on the same machine, journal and endpoint.

    Args:
        folder: where the journal is.
        machine: built-in name or machine file.
        name: in the key space.
        recorder: whether it has one; most tests look at other things, and save its start.
        inside: what its command is prefixed with, to run in a network namespace. listen: its first endpoint.

    Attributes:
        endpoint: of the first start; the system chose its port.
        said: lines of standard error of the present start.
    """

    def __init__(
        self,
        folder: Path,
        machine: str,
        name: str,
        *,
        recorder: bool = False,
        inside: Sequence[str] = (),
        listen: str = "tcp/127.0.0.1:0",
    ) -> None:
        self.machine = machine
        self.name = name
        self.endpoint = listen
        self._inside = inside
        self.said: list[str] = []
        self._recorder = "--recorder" if recorder else "--no-recorder"
        self.journal = folder / "journal.db"
        self._process: subprocess.Popen[str] | None = None
        self._reader: threading.Thread | None = None
        self._executors: set[int] = set()

    def start(self) -> None:
        """Starts it and waits until it says that it is ready."""
        options = ["--machine", self.machine, "--name", self.name, "--listen", self.endpoint, self._recorder]
        self.said = []
        process = subprocess.Popen(
            [
                *self._inside,
                sys.executable,
                "-m",
                "mcserver",
                "run",
                *options,
                "--journal",
                str(self.journal),
            ],
            stderr=subprocess.PIPE,
            text=True,
            env=environment(),
            cwd=ROOT,
        )
        self._process = process
        ready: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, args=(process, self.said, ready), daemon=True)
        self._reader.start()
        endpoint = ready.get(timeout=START_LIMIT_S)
        if endpoint is None:
            raise RuntimeError("mcserver run ended: " + "".join(self.said))
        self.endpoint = endpoint
        self._executors.update(self.executors())

    @staticmethod
    def _read(process: subprocess.Popen[str], said: list[str], ready: queue.Queue[str | None]) -> None:
        assert process.stderr is not None
        with process.stderr:
            for line in process.stderr:
                said.append(line)
                found = READY.search(line)
                if found is not None:
                    ready.put(found[1])
        ready.put(None)

    @property
    def running(self) -> bool:
        """Whether it has been started, and has not ended."""
        return self._process is not None and self._process.poll() is None

    @property
    def pid(self) -> int:
        """Of the server's process."""
        assert self._process is not None
        return self._process.pid

    def executors(self) -> list[int]:
        """Process ids of the executors that this server has started."""
        return [pid for pid in children(self.pid) if EXECUTOR in command_line(pid)]

    def planners(self) -> list[int]:
        """Process ids of the planners that this server has started and that run."""
        return [pid for pid in children(self.pid) if PLANNER in command_line(pid)]

    def end(self, number: signal.Signals) -> int:
        """Sends a signal to the server alone, and waits for its end; gives the exit code."""
        assert self._process is not None
        self._process.send_signal(number)
        return self.wait()

    def wait(self) -> int:
        """Waits for the server's end; gives the exit code."""
        assert self._process is not None
        assert self._reader is not None
        code = self._process.wait(STOP_LIMIT_S)
        # its executor may hold standard error a moment longer
        self._reader.join(STOP_LIMIT_S)
        return code

    def close(self) -> None:
        """Ends whatever of it is still there."""
        if self._process is not None and self.running:
            self._process.terminate()
            try:
                self._process.wait(STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for pid in self._executors:
            if EXECUTOR in command_line(pid):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        if self._reader is not None:
            self._reader.join(STOP_LIMIT_S)


class CommandProcess:
    """``mcserver ARGUMENTS --json`` as a process of its own, ready for requests.

    Args:
        inside: what its command is prefixed with.
        errors: takes its standard error; None: that of this process does.

    Attributes:
        url: where it is reached, as its first line says.
    """

    def __init__(
        self, *arguments: str, inside: Sequence[str] = (), errors: IO[str] | int | None = None
    ) -> None:
        self.process = subprocess.Popen(
            [*inside, sys.executable, "-m", "mcserver", *arguments, "--json"],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env=environment(),
            cwd=ROOT,
        )
        assert self.process.stdout is not None
        self.url: str = json.loads(self.process.stdout.readline())["url"]

    def close(self) -> None:
        """Ends it in order; kills it where it does not end."""
        self.process.terminate()
        try:
            self.process.wait(STOP_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def children(pid: int) -> list[int]:
    """Process ids of a process's children."""
    found: list[int] = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            found += [int(child) for child in task.read_text().split()]
    return found


def command_line(pid: int) -> str:
    """As it was started; empty where there is no such process, or only its exit code is left."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def wait_for_end(pid: int, limit_s: float) -> bool:
    """Whether a process, of whomever, ends within the time."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([descriptor], [], [], limit_s)[0])
    finally:
        os.close(descriptor)
