"""The server's heartbeat to the executor, which stops every axis without it.

It has its own thread, so that long planning or a burst of requests does not stop the machine; but it stops if
the loop or the planner hangs, because then nobody is in control.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable

PERIOD_S = 0.02
LOOP_LIMIT_S = 3.0
PLANNER_LIMIT_S = 5.0
LOOP_PERIOD_S = 0.1


class Heartbeat:
    """Sends heartbeats from `start` to `stop`.

    Args:
        beat: sends one to the executor.
        planner_seen: time of the planner thread's last activity [s of `time.monotonic`].
    """

    def __init__(self, beat: Callable[[], None], planner_seen: Callable[[], float]) -> None:
        self._beat = beat
        self._planner_seen = planner_seen
        self._loop_seen = time.monotonic()
        self._stopping = threading.Event()
        self._timer: asyncio.TimerHandle | None = None
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)

    def start(self) -> None:
        """Start; called in the loop that is watched."""
        self._touch(asyncio.get_running_loop())
        self._thread.start()

    def stop(self) -> None:
        """Stop; called in the loop, too."""
        self._stopping.set()
        if self._timer is not None:
            self._timer.cancel()
        if self._thread.is_alive():
            self._thread.join(1.0)

    def _touch(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop_seen = time.monotonic()
        self._timer = loop.call_later(LOOP_PERIOD_S, self._touch, loop)

    def _run(self) -> None:
        while not self._stopping.wait(PERIOD_S):
            now = time.monotonic()
            if now - self._loop_seen < LOOP_LIMIT_S and now - self._planner_seen() < PLANNER_LIMIT_S:
                self._beat()
