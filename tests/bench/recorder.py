"""What the recorder costs at 64 axes and 1 kHz: CPU, bytes a minute, late cycles beside it and without."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mcclient import sync
from numpy.typing import NDArray

from mcserver.executor.shm.feedback import CYCLE, TIME, AxisCondition, FeedbackRing, FeedbackRow
from mcserver.machine.machine_file import parse_machine
from mcserver.recorder.chunks import ChunkBuilder
from mcserver.recorder.cycle_encoder import CycleEncoder
from mcserver.simulation.tool_poses import ToolPoses
from tests.bench.figures import Figure, NotAvailable, processor_seconds
from tests.bench.server import server
from tests.bench.telemetry import AXES, MACHINE, cpu_share
from tests.e2e.servers import children, command_line

CYCLES_A_CHUNK, CHUNKS = 500, 4
RECORDER = "mcserver.recorder.process"

Rows = NDArray[np.float64]


def measure() -> list[Figure]:
    """Computed rows through the recorder's own code, then a real server with and without it."""
    found = []
    for what, motion in (
        ("axes stand", standing),
        ("axes move", moving),
        ("axes move, noisy encoders", noisy),
    ):
        cpu, written, plain = encoded(motion)
        found.append(Figure(f"CPU, {what}", cpu, "% of a core", None, "", "≤ 5 %"))
        found.append(Figure(f"file, {what}", written, "MB a minute", plain, "uncompressed"))
    with server(MACHINE, recorder=False) as reached:
        alone = late_cycles(reached.endpoint)
    with server(MACHINE) as reached:
        beside = late_cycles(reached.endpoint)
        recorders = [pid for pid in children(reached.process.pid) if RECORDER in command_line(pid)]
        if not recorders:
            raise NotAvailable("the recorder has not started")
        share = cpu_share(recorders[0])
    return [
        *found,
        Figure("the whole process beside a server, axes stand", share, "% of a core", None, "", "≤ 5 %"),
        Figure("late cycles beside it", beside, "in 10 000", alone, "without it", "no more"),
    ]


def encoded(motion: Callable[[Rows, FeedbackRow], None]) -> tuple[float, float, float]:
    """Share of a core [%], and MB a minute, compressed and not."""
    machine = parse_machine(MACHINE)
    ring = FeedbackRing(None, AXES)
    row = FeedbackRow(AXES)
    count = CYCLES_A_CHUNK * CHUNKS
    for cycle in range(count):
        row.row[TIME], row.row[CYCLE] = cycle * 1e-3, cycle
        row.condition[:] = AxisCondition.MOVING
        motion(np.full(AXES, cycle * 1e-3) + 0.1 * np.arange(AXES), row)
        ring.put(row.row)
    _, rows = ring.since(0, count)
    encoder = CycleEncoder(machine, ring, 1.7e9, ToolPoses(machine, None))
    compressed = plain = 0

    def work() -> None:
        nonlocal compressed, plain
        compressed = plain = 0
        for first in range(0, len(rows), CYCLES_A_CHUNK):
            builder = ChunkBuilder()
            for channel, times, records in encoder.blocks(rows[first : first + CYCLES_A_CHUNK]):
                builder.add_block(channel, times, records)
            chunk = builder.finish()
            assert chunk is not None
            compressed += len(chunk.data)
            plain += chunk.uncompressed_size

    seconds = processor_seconds(work)
    a_minute = 60.0 / (len(rows) * 1e-3) * 1e-6
    return 100.0 * seconds / (len(rows) * 1e-3), compressed * a_minute, plain * a_minute


def standing(_phase: Rows, _row: FeedbackRow) -> None:
    """Nothing changes."""


def moving(phase: Rows, row: FeedbackRow) -> None:
    """Each axis swings by itself; its drive lags."""
    row.setpoint[:] = 0.3 * np.sin(phase)
    row.velocity[:] = 0.3 * np.cos(phase)
    row.actual[:] = 0.3 * np.sin(phase - 0.004)
    row.actual_velocity[:] = 0.3 * np.cos(phase - 0.004)
    row.torque[:] = 2.0 * np.sin(phase)


def noisy(phase: Rows, row: FeedbackRow) -> None:
    """The same with encoders of 1 µm and noise in velocity and torque."""
    moving(phase, row)
    chance = np.random.default_rng(int(row.row[CYCLE]))
    row.actual[:] = np.round(row.actual * 1e6 + chance.normal(size=AXES)) * 1e-6
    row.actual_velocity[:] += 1e-3 * chance.normal(size=AXES)
    row.torque[:] += 0.05 * chance.normal(size=AXES)


def late_cycles(endpoint: str) -> float:
    """Late cycles in 10 000, over some seconds."""
    with sync.Machine.connect("bench", endpoint, timeout_s=30.0) as machine:
        states = machine.telemetry()
        first = next(states)
        last = first
        while last.t < first.t + 10.0:
            last = next(states)
    return float(last.late_cycles - first.late_cycles)
