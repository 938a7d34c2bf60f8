"""Streams lines at a steady rate for minutes: memory, lost cycles, acknowledgements.

``python -m tests.bench.soak --minutes 30 --rate 500`` starts a server of its own with simulated drives and
streams short moves to it. Beside it a loop without work wakes at the same rate: its late cycles are the floor
of the executor's.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import sys
import time
from collections.abc import Iterator

from mcclient.machine import Machine

from tests.bench.server import server
from tests.bench.telemetry import resident_mib
from tests.bench.wake_up import PERIOD_NS, latencies, start
from tests.e2e.servers import children, command_line

CHUNK = 50


def _moves() -> Iterator[str]:
    """An endless path of 0.5 mm moves round a square of 100 mm: some 600 lines/s can be moved."""
    yield "G1010"
    yield "G94 F24000 G90"
    while True:
        for x0, y0, dx, dy in ((0, 0, 1, 0), (100, 0, 0, 1), (100, 100, -1, 0), (0, 100, 0, -1)):
            for step in range(1, 201):
                yield f"G01 X{x0 + step * dx / 2} Y{y0 + step * dy / 2}"


NAMES = {
    "mcserver.executor.process": "executor",
    "mcserver.planning.process": "planner",
}


def _sizes(server: int) -> dict[str, float]:
    """Resident memory of the server and of the processes that it has started [MiB]."""
    sizes = {"server": resident_mib(server)}
    for pid in children(server):
        with contextlib.suppress(OSError):
            module = command_line(pid).strip().rpartition(" ")[2]
            sizes[NAMES.get(module, module)] = resident_mib(pid)
    return sizes


async def _stream(endpoint: str, minutes: float, rate: float, pid: int) -> None:
    started = time.monotonic()
    end = started + minutes * 60.0
    moves = _moves()
    sent = 0
    memory: list[tuple[float, dict[str, float]]] = []
    async with Machine.connect(connect=endpoint, timeout_s=30.0) as machine:
        before = (await machine.status()).late_cycles
        async with machine.program(name="soak") as program:
            next_report = started
            while time.monotonic() < end:
                sent = await program.send_lines([next(moves) for _ in range(CHUNK)])
                now = time.monotonic()
                if now >= next_report:
                    next_report += 15.0
                    sizes = _sizes(pid)
                    memory.append((now - started, sizes))
                    print(
                        f"{now - started:7.0f} s  sent {sent}  accepted {program.accepted_through}  "
                        f"done {program.done_through}  "
                        + "  ".join(f"{name} {size:.1f} MiB" for name, size in sizes.items()),
                        flush=True,
                    )
                ahead = sent / rate - (now - started)
                if ahead > 0.0:
                    await asyncio.sleep(ahead)
            result = await program.finish()
        status = await machine.status()
    settled = [each for each in memory if each[0] >= 60.0] or memory
    print(f"lines sent {sent}, accepted {result.accepted}, done {result.done}, state {result.state}")
    for name, size in settled[0][1].items():
        print(f"memory from {size:.1f} to {settled[-1][1].get(name, 0.0):.1f} MiB ({name})")
    print(f"late cycles of the executor {status.late_cycles - before}")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--minutes", type=float, default=30.0)
    options.add_argument("--rate", type=float, default=500.0)
    chosen = options.parse_args()
    with server() as reached:
        cycles = round(chosen.minutes * 60e9 / PERIOD_NS)
        floor = start([sys.executable, "-m", "tests.bench.wake_up_loop", str(cycles), str(PERIOD_NS)])
        asyncio.run(_stream(reached.endpoint, chosen.minutes, chosen.rate, reached.process.pid))
        late = sum(each > PERIOD_NS / 1000.0 for each in latencies(floor))
        print(f"late cycles of a loop without work beside it {late}")
        print(f"journal {reached.process.journal.stat().st_size / 2**20:.1f} MiB")


if __name__ == "__main__":
    main()
