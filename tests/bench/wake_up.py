"""How late a thread wakes each millisecond: the executor's way beside a C loop at the same moment."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.bench.figures import Figure, NotAvailable, percentiles

CYCLES = 4000
PERIOD_NS = 1_000_000
FLOOR = Path(__file__).with_name("wake_up_floor.c")


def measure() -> list[Figure]:
    """Both loops run together, on whatever CPUs the kernel gives them."""
    with tempfile.TemporaryDirectory() as folder:
        floor = start([str(compiled(Path(folder))), str(CYCLES), str(PERIOD_NS)])
        ours = start([sys.executable, "-m", "tests.bench.wake_up_loop", str(CYCLES), str(PERIOD_NS)])
        least, taken = latencies(floor), latencies(ours)
    what, goals = "wake-up latency", {0.999: "≤ 1.5"}
    return percentiles(what, taken, least, "a C loop", goals, shares=(0.5, 0.99, 0.999))


def compiled(folder: Path) -> Path:
    """The floor's program.

    Raises:
        NotAvailable: there is no C compiler, or it refuses.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise NotAvailable("no C compiler for the floor: apt-get install gcc libc6-dev")
    program = folder / "floor"
    built = subprocess.run(
        [compiler, "-O2", "-o", program, FLOOR], capture_output=True, text=True, check=False
    )
    if built.returncode:
        raise NotAvailable(f"the floor does not compile: {built.stderr.strip().splitlines()[-1]}")
    return program


def start(arguments: list[str]) -> subprocess.Popen[str]:
    """A loop in a process of its own that prints one latency a line [ns]."""
    return subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)


def latencies(loop: subprocess.Popen[str]) -> list[float]:
    """Latencies [µs], without the first cycles."""
    printed, _ = loop.communicate(timeout=60)
    if loop.returncode:
        raise NotAvailable(f"a loop ended with {loop.returncode}")
    return [int(line) / 1000.0 for line in printed.split()[100:]]
