"""From submitting a line to a standing machine until its first setpoint moves, by the executor's clock."""

from __future__ import annotations

import threading
import time
from collections import deque

import msgspec
import numpy as np

from tests.bench.figures import Figure, NotAvailable, percentiles
from tests.bench.server import server

LINES = 60
PATIENCE_S = 5.0
SETPOINT = 0


class _Watcher:
    """Notes when axis 0 first moves after `arm`."""

    def __init__(self, epoch: float, cycle_s: float, width: int, fields: int) -> None:
        self._epoch, self._cycle, self._shape = epoch, cycle_s, (width, fields)
        self._last: float | None = None
        self._moved: deque[float] = deque(maxlen=4096)
        self._came = threading.Event()

    def arm(self) -> None:
        self._moved.clear()
        self._came.clear()

    def first(self) -> float:
        """Unix time of the first cycle whose setpoint differs from the one before it."""
        if not self._came.wait(PATIENCE_S):
            raise NotAvailable("nothing moved")
        return self._moved[0]

    def take(self, payload: bytes) -> None:
        _, t, rows = msgspec.msgpack.decode(payload)
        setpoints = np.frombuffer(rows, "<f4").reshape(-1, *self._shape)[:, 0, SETPOINT].tolist()
        for index, value in enumerate(setpoints):
            if self._last is not None and value != self._last:
                self._moved.append(self._epoch + t + index * self._cycle)
                self._came.set()
            self._last = value


def measure() -> list[Figure]:
    """Short moves, each to a machine that has come to rest."""
    with server() as reached:
        info = reached.ask("info")
        telemetry = info["telemetry"]
        watcher = _Watcher(info["epoch"], info["cycle_s"], len(telemetry["axes"]), len(telemetry["fields"]))
        subscriber = reached.session.declare_subscriber(
            f"mc/@v1/{reached.machine}/tele/batch", lambda sample: watcher.take(sample.payload.to_bytes())
        )
        opened = reached.ask("@rpc/bench/open", request=1)
        taken = []
        lines = ["G1010 P0", "G94", "F6000"]
        for number in range(1, LINES + len(lines) + 1):
            moving = number > len(lines)
            line = f"G01 X{(number - len(lines)) % 2}" if moving else lines[number - 1]
            watcher.arm()
            start = time.time()
            reached.ask(
                "@rpc/bench/submit",
                request=1 + number,
                program=opened["program"],
                first=number,
                lines=[line],
            )
            if moving:
                taken.append(1000.0 * (watcher.first() - start))
            time.sleep(0.15)
        subscriber.undeclare()
    goals = dict.fromkeys((0.5, 0.99), "≤ 10 ms")
    return percentiles("submit → first motion", taken[1:], goals=goals, unit="ms")
