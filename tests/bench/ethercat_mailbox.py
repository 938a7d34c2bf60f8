"""Cycles that are late beside a mailbox that is read without a pause, and without, at 100 Hz and at 1 kHz.

The cycle, its mailbox thread and the reader share one interpreter here; in a server the reader is another
process. The simulated drives share the computer's processors, so that the control run beside it counts.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from contextlib import closing, suppress
from pathlib import Path

from mcserver.canopen.canopen_errors import DriveError
from mcserver.drives.bus import DriveMode, DriveState
from tests.bench.figures import Figure, NotAvailable
from tests.ethercat.rig import CYCLE_HZ, Cycle, Namespace, SimulatedLine, line_of, missing_means

RATES_HZ = (100, 1000)
SECONDS = 12.0
NAME = (0x1008, 0)


def measure() -> list[Figure]:
    """Three drives energized; a cycle is late where its exchange ends when the next one is due."""
    lacking = missing_means()
    if lacking:
        raise NotAvailable(lacking)
    figures = []
    for rate in RATES_HZ:
        alone, _ = _late_share(rate, reading=False)
        beside, reads = _late_share(rate, reading=True)
        against = "the same without a read"
        figures.append(Figure(f"late cycles at {rate} Hz, {reads:.0f} reads/s", beside, "%", alone, against))
    return figures


def _late_share(rate: int, *, reading: bool) -> tuple[float, float]:
    """Return the share of late cycles [%], and readings a second."""
    text = line_of(3, silence_cycles=1000, bus="distributed_clocks = false")
    text = text.replace(f"cycle_hz = {CYCLE_HZ}", f"cycle_hz = {rate}").replace("= 2000\n", "= 10000\n")
    with (
        closing(Namespace(f"mc-mailbox-{os.getpid()}")) as namespace,
        tempfile.TemporaryDirectory() as folder,
    ):
        file = Path(folder) / "line.toml"
        file.write_text(text)
        with closing(SimulatedLine(namespace, file)), closing(Cycle(namespace, text)) as cycle:
            cycle.command(DriveMode.POSITION, DriveState.ENERGIZED)
            stopping, reads = threading.Event(), [0]

            def read() -> None:
                while not stopping.is_set():
                    # drives that share a busy computer do not answer each time
                    with suppress(DriveError):
                        cycle.line.drives[0].sdo.upload(*NAME)
                        reads[0] += 1

            reader = threading.Thread(target=read)
            if reading:
                reader.start()
            try:
                late, cycles = _run(cycle)
            finally:
                stopping.set()
                if reading:
                    reader.join()
    return 100.0 * late / cycles, reads[0] / SECONDS


def _run(cycle: Cycle) -> tuple[int, int]:
    """Exchange with realtime priority at the machine's rate; return late cycles, and all."""
    period = cycle.machine.cycle_s
    due = time.monotonic()
    end, late, cycles = due + SECONDS, 0, 0
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
    try:
        while due < end:
            due += period
            time.sleep(max(0.0, due - time.monotonic()))
            cycle.bus.exchange(cycle.setpoints)
            cycles += 1
            if time.monotonic() - due > period:
                late += 1
                due = max(due, time.monotonic() - 10.0 * period)
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return late, cycles
