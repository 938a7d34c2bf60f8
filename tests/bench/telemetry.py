"""What telemetry of 64 axes costs the server: CPU with nobody listening and with 50 subscribers."""

from __future__ import annotations

import os
import time
from pathlib import Path

from tests.bench.figures import Figure
from tests.bench.server import companion, server
from tests.machine_text import axes_text

AXES, SUBSCRIBERS = 64, 50
SETTLE_S, WATCH_S = 1.0, 4.0
_AXES_TEXT = axes_text(range(AXES), acceleration=1000.0, drive="simulated")
MACHINE = f'[machine]\nname = "bench"\ncycle_hz = 1000\n{_AXES_TEXT}'


def measure() -> list[Figure]:
    """Of the server's own process; the executor has its own."""
    with server(MACHINE) as reached:
        alone = cpu_share(reached.process.pid)
        command = ("tests.bench.listeners", reached.endpoint, reached.machine, str(SUBSCRIBERS))
        with companion(*command) as listeners:
            heard = cpu_share(reached.process.pid)
            messages = int(listeners.communicate(timeout=30)[0] or 0)
    return [
        Figure("nobody listens", alone, "% of a core", None, "", "1.5 %"),
        Figure(f"{SUBSCRIBERS} subscribers", heard, "% of a core", alone, "nobody listens", "≤ 15 %"),
        Figure("messages that they got", float(messages), "", None, "", "100 a second each"),
    ]


def cpu_share(process: int) -> float:
    """CPU time of a process while being watched [% of a core]."""
    time.sleep(SETTLE_S)
    before, start = cpu_seconds(process), time.perf_counter()
    time.sleep(WATCH_S)
    return 100.0 * (cpu_seconds(process) - before) / (time.perf_counter() - start)


def cpu_seconds(process: int) -> float:
    """User and system time since its start (proc(5), fields 14 and 15) [s]."""
    fields = Path(f"/proc/{process}/stat").read_text("ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mib(process: int) -> float:
    """Memory of a process that is not on disk [MiB]."""
    status = Path(f"/proc/{process}/status").read_text("ascii")
    return next(int(line.split()[1]) / 1024.0 for line in status.splitlines() if line.startswith("VmRSS"))
