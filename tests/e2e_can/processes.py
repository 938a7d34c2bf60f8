"""Programs in processes of their own that say when they are ready."""

from __future__ import annotations

import contextlib
import os
import queue
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence

from tests.e2e.servers import ROOT, STOP_LIMIT_S, environment

# in an emulated machine Python itself takes seconds to start
READY_LIMIT_S = 300.0
SAID_LINES = 2000
# below the executor's
PRIORITY = 20


class ReadyProcess:
    """A Python module as a process; made when it has said ``READY``.

    Args:
        arguments: for ``python -m``.

    Attributes:
        ready: the rest of the line behind ``READY``.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        self.said: list[str] = []
        self._process = subprocess.Popen(
            [sys.executable, "-m", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment(),
            cwd=ROOT,
        )
        lines: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, args=(lines,), daemon=True)
        self._reader.start()
        try:
            ready = lines.get(timeout=READY_LIMIT_S)
        except queue.Empty:
            ready = None
        if ready is None:
            self.close()
            raise RuntimeError(f"{' '.join(arguments)} is not ready: {''.join(self.said)}")
        self.ready = ready
        # real drives are on time; without the right to it they are as late as this computer makes them
        with contextlib.suppress(OSError):
            os.sched_setscheduler(self.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))

    def _read(self, lines: queue.Queue[str | None]) -> None:
        assert self._process.stdout is not None
        with self._process.stdout:
            for line in self._process.stdout:
                if len(self.said) < SAID_LINES:
                    self.said.append(line)
                if line.startswith("READY"):
                    lines.put(line.removeprefix("READY").strip())
        lines.put(None)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def endpoint(self) -> tuple[str, int]:
        """Host and port that the line has named last."""
        found = re.findall(r"([\w.]+):(\d+)", self.ready)
        host, port = found[-1]
        return host, int(port)

    def kill(self) -> None:
        """Without a chance to say anything."""
        self.end(signal.SIGKILL)

    def end(self, number: signal.Signals) -> int:
        """Sends a signal, and waits for its end; gives the exit code."""
        self._process.send_signal(number)
        code = self._process.wait(STOP_LIMIT_S)
        self._reader.join(STOP_LIMIT_S)
        return code

    def close(self) -> None:
        """Ends it, if it is still there."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(STOP_LIMIT_S)
        self._reader.join(STOP_LIMIT_S)
