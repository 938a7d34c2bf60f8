"""Schedules of the simulated cell by the thousand: ``make schedules ARGS="--first 0 --count 20000"``.

Each seed is one run of clients, network, service, journal, planner and executor with faults at random moments
(`tests.service.simulated_cell`). The first seed that breaks a law is printed; it replays to the letter.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
import time
from pathlib import Path

from mcserver.service import program_table
from tests.service.simulated_laws import Violation
from tests.service.test_simulated_faults import NoHeartbeat, simulate

REPORT_S = 60.0


def run(first: int, count: int, folder: Path) -> int:
    """Run the seeds; the exit code: 1 where one of them breaks a law."""
    started = reported = time.monotonic()
    lines = 0
    for seed in range(first, first + count):
        journal = folder / f"{seed}.db"
        try:
            executed, _ = simulate(seed, journal)
        except Violation as violation:
            print(f"seed {seed}: {violation}", flush=True)
            return 1
        lines += sum(map(len, executed.values()))
        for left in folder.iterdir():
            left.unlink()
        now = time.monotonic()
        if now - reported >= REPORT_S:
            reported = now
            print(f"{now - started:7.0f} s  {seed + 1 - first} schedules, {lines} lines", flush=True)
    print(f"{count} schedules from seed {first}, {lines} lines: every one once and in order, or not at all")
    return 0


def main() -> int:
    """The exit code: 0 where every schedule keeps the laws."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--count", type=int, default=20_000)
    chosen = options.parse_args()
    # faults are meant here: what the server logs about them is not
    logging.disable(logging.CRITICAL)
    # the clock of the simulation is not that of threads
    program_table.Heartbeat = NoHeartbeat  # type: ignore[misc, assignment]
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        return run(chosen.first, chosen.count, Path(folder))


if __name__ == "__main__":
    sys.exit(main())
