"""One exchange with CiA 402 drives over EtherCAT, beside the bare frame of SOEM on the same line.

Processor time of the cycle's own thread: the simulated drives have priority, and on one computer take the
processor as soon as a frame is sent. They keep up with 100 cycles a second, and after such a pause the
processor's caches are cold. So the exchange besides SOEM's frame is measured with the pauses of 1 kHz, too,
on a frame that comes back as the latest one did: a cycle takes the sum of both.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from mcserver.drives.bus import DriveMode, DriveState
from mcserver.ethercat.port import EthercatPort
from tests.bench.figures import Figure, NotAvailable, percentiles
from tests.ethercat.rig import CYCLE_HZ, Cycle, Namespace, SimulatedLine, line_of, missing_means

CYCLES = 500
WARM_UP = 100
GOALS = {3: "≤ 100 µs", 16: "≤ 150 µs", 64: "≤ 400 µs"}
LATE_US = 200
# Between two cycles of 1 kHz.
PAUSE_S = 0.001


@dataclass
class Standing:
    """In the place of pysoem's master: every frame comes back as the latest one did."""

    counted: int

    def send_processdata(self) -> int:
        return 1

    def receive_processdata(self, timeout_us: int) -> int:
        del timeout_us
        return self.counted


def measure() -> list[Figure]:
    """3, 16 and 64 axes in position mode and moving, simulated in a process of their own."""
    lacking = missing_means()
    if lacking:
        raise NotAvailable(lacking)
    figures = []
    for axes, goal in GOALS.items():
        namespace = Namespace(f"mc-bench-{os.getpid()}")
        try:
            taken, frames, rest = _exchanges(namespace, axes)
        finally:
            namespace.close()
        against = "SOEM's frame on this line, sent and received"
        figures += percentiles(f"{axes} axes, exchange at {CYCLE_HZ} Hz", taken, frames, against)
        both = [median(frames) + each for each in rest]
        figures += percentiles(f"{axes} axes, exchange at 1 kHz", both, frames, against, {0.5: goal})
    return figures


def _exchanges(namespace: Namespace, axes: int) -> tuple[list[float], list[float], list[float]]:
    """Return processor times [µs] at the line's rate of exchanges with all drives on their way, and of bare
    frames; of exchanges without the frame, at 1 kHz."""
    text = line_of(axes)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "line.toml"
        file.write_text(text)
        line = SimulatedLine(namespace, file)
        try:
            cycle = Cycle(namespace, text)
            try:
                cycle.command(DriveMode.POSITION, DriveState.ENERGIZED)
                return _moving(cycle), _frames(cycle), _standing(cycle)
            finally:
                cycle.close()
        finally:
            line.close()


def _moving(cycle: Cycle) -> list[float]:
    step = 1e-5
    cycle.setpoints.velocity[:] = step / cycle.machine.cycle_s

    def exchange() -> None:
        cycle.setpoints.position[:] += step
        feedback = cycle.bus.exchange(cycle.setpoints)
        if (feedback.state != DriveState.ENERGIZED).any():
            raise RuntimeError(f"a drive has failed: {feedback.fault}")

    return _timed(exchange, cycle.machine.cycle_s)


def _frames(cycle: Cycle) -> list[float]:
    soem = _port(cycle)._soem

    def frame() -> None:
        soem.receive_processdata(LATE_US)
        soem.send_processdata()

    return _timed(frame, cycle.machine.cycle_s)


def _standing(cycle: Cycle) -> list[float]:
    port = _port(cycle)
    port._soem, soem = Standing(3 * len(cycle.machine.axes)), port._soem
    try:
        return _timed(lambda: cycle.bus.exchange(cycle.setpoints), PAUSE_S)
    finally:
        port._soem = soem


def _port(cycle: Cycle) -> EthercatPort:
    assert isinstance(cycle.bus.port, EthercatPort)
    return cycle.bus.port


def _timed(work: Callable[[], object], pause_s: float) -> list[float]:
    taken = []
    for _ in range(WARM_UP + CYCLES):
        time.sleep(pause_s)
        start = time.thread_time_ns()
        work()
        taken.append(1e-3 * (time.thread_time_ns() - start))
    return taken[WARM_UP:]
