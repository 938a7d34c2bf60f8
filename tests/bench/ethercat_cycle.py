"""One exchange with CiA 402 drives over EtherCAT, beside a frame of as many bytes on the same line.

Processor time of the cycle's own thread: the simulated drives have priority, and on one computer take the
processor as soon as a frame is sent.
"""

from __future__ import annotations

import os
import socket
import tempfile
import time
from pathlib import Path

from mcserver.drives.bus import DriveMode, DriveState
from tests.bench.figures import Figure, NotAvailable, percentiles
from tests.ethercat.rig import Cycle, Namespace, SimulatedLine, line_of, missing_means

CYCLES = 500
WARM_UP = 100
GOALS = {3: "≤ 100 µs", 16: "≤ 150 µs", 64: "≤ 400 µs"}
# controlword, target and mode to a drive; statusword, position, velocity, torque and mode from it
BYTES_A_DRIVE = 30
MOST = 1500
ETHERTYPE = 0x88B5


def measure() -> list[Figure]:
    """3, 16 and 64 axes in position mode and moving, simulated in a process of their own."""
    lacking = missing_means()
    if lacking:
        raise NotAvailable(lacking)
    figures = []
    for axes, goal in GOALS.items():
        namespace = Namespace(f"mc-bench-{os.getpid()}")
        try:
            floor = _frames(namespace, BYTES_A_DRIVE * axes)
            taken = _exchanges(namespace, axes)
        finally:
            namespace.close()
        against = "sending as many bytes on this line, and taking them at its end"
        figures += percentiles(f"{axes} axes, exchange", taken, floor, against, {0.5: goal})
    return figures


def _exchanges(namespace: Namespace, axes: int) -> list[float]:
    """Return processor times of exchanges [µs]: at the line's rate, with all drives on their way."""
    text = line_of(axes)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "line.toml"
        file.write_text(text)
        line = SimulatedLine(namespace, file)
        try:
            cycle = Cycle(namespace, text)
            try:
                cycle.command(DriveMode.POSITION, DriveState.ENERGIZED)
                return _moving(cycle)
            finally:
                cycle.close()
        finally:
            line.close()


def _moving(cycle: Cycle) -> list[float]:
    step = 1e-5
    taken = []
    cycle.setpoints.velocity[:] = step / cycle.machine.cycle_s
    for number in range(WARM_UP + CYCLES):
        time.sleep(cycle.machine.cycle_s)
        cycle.setpoints.position[:] += step
        start = time.thread_time_ns()
        feedback = cycle.bus.exchange(cycle.setpoints)
        taken.append(1e-3 * (time.thread_time_ns() - start))
        if (feedback.state != DriveState.ENERGIZED).any():
            raise RuntimeError(f"a drive has failed in cycle {number}: {feedback.fault}")
    return taken[WARM_UP:]


def _frames(namespace: Namespace, size: int) -> list[float]:
    """Return processor times of sending so many bytes over the line and receiving them there [µs]."""
    taken = []
    with namespace.entered():
        one, other = (socket.socket(socket.AF_PACKET, socket.SOCK_RAW, ETHERTYPE) for _ in range(2))
    with one, other:
        one.bind(("ec0", ETHERTYPE))
        other.bind(("ec1", ETHERTYPE))
        head = b"\xff" * 6 + bytes(6) + ETHERTYPE.to_bytes(2, "big")
        parts = [head + bytes(min(MOST, size - at)) for at in range(0, size, MOST)]
        for _ in range(CYCLES):
            start = time.thread_time_ns()
            for part in parts:
                one.send(part)
            for part in parts:
                other.recv(len(part))
            taken.append(1e-3 * (time.thread_time_ns() - start))
    return taken
