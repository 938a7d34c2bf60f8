"""Files in the manner of ten posts: processor time of ``mcserver check`` beside LinuxCNC's ``rs274``."""

from __future__ import annotations

import math
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from mcserver.machine.machine_file import builtin_text
from tests.bench.figures import Figure, NotAvailable

LINES: Final = 100_000
HEAD: Final = "G21 G90 G94 G17 F3000"
# each line from its number and a point on a circle of 50 mm [mm]
POSTS: Final[dict[str, tuple[str, Callable[[int, float, float], str]]]] = {
    "three words": (HEAD, lambda k, x, y: f"G1 X{x:.4f} Y{y:.4f} Z{-k * 1e-4:.4f}"),
    "F on each line": (HEAD, lambda k, x, y: f"G1 X{x:.4f} Y{y:.4f} F{1000 + k % 500}"),
    "S on each line (laser)": (f"{HEAD}\nM3 S0", lambda k, x, y: f"G1 X{x:.4f} Y{y:.4f} S{k % 900}"),
    "line numbers, no blanks, CR LF": (HEAD, lambda k, x, y: f"N{k}G1X{x:.4f}Y{y:.4f}\r"),
    "a comment on each line": (HEAD, lambda k, x, y: f"G1 X{x:.4f} Y{y:.4f} (chord {k})"),
    "no code": (f"{HEAD}\nG1 X0", lambda _, x, y: f"X{x:.4f} Y{y:.4f}"),
    "axes in turn": (HEAD, lambda k, x, y: f"G1 X{x:.4f}" if k % 2 else f"G1 Y{y:.4f}"),
    "arcs between": (HEAD, lambda k, x, y: f"G{1 + k % 2} X{x:.4f} Y{y:.4f}" + " R40" * (k % 2)),
    "retracts": (
        HEAD,
        lambda k, x, y: f"G0 Z{5 * (k % 20 == 0)}" if k % 10 == 0 else f"G1 X{x:.4f} Y{y:.4f}",
    ),
    "increments, inches": ("G20 G91 G94 F99", lambda _, x, y: f"G1 X{x * 1e-4:.6f} Y{y * 1e-4:.6f}"),
}
MACHINE: Final = """
[dialect]
profile = "cnc"
[dialect.outputs]
M3 = { beam = "S" }
M4 = { beam = "S" }
M5 = { beam = 0 }
[[output]]
number = 0
name = "beam"
kind = "analog"
max = 1000.0
laser = true
"""


def measure() -> list[Figure]:
    """Each post's file, start-up of both included."""
    rs274 = shutil.which("rs274")
    if rs274 is None:
        raise NotAvailable("rs274 is not installed (Debian: linuxcnc-uspace)")
    with TemporaryDirectory() as name:
        folder = Path(name)
        machine = folder / "machine.toml"
        machine.write_text(builtin_text("cartesian") + MACHINE, "utf-8")
        (folder / "none.var").touch()
        found = []
        for post, (head, line) in POSTS.items():
            program = folder / "part.ngc"
            around = ((50.0 * math.cos(k * 0.01), 50.0 * math.sin(k * 0.01)) for k in range(LINES))
            body = "\n".join(line(k, x, y) for k, (x, y) in enumerate(around))
            program.write_text(f"{head}\n{body}\nM2\n", "utf-8", newline="")
            ours = _seconds(
                [sys.executable, "-m", "mcserver", "check", str(program), "--machine", str(machine)]
            )
            theirs = _seconds([rs274, "-g", "-v", str(folder / "none.var"), str(program), "/dev/null"])
            found.append(
                Figure(post, LINES / ours, "lines/s", LINES / theirs, "rs274", "1.5 × its processor time")
            )
        return found


def _seconds(command: list[str]) -> float:
    """Processor time of a command, the least of three, as an installed one, which has its byte code [s]."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    found = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        nothing = subprocess.DEVNULL
        subprocess.run(command, check=True, env=environment, stdout=nothing, stderr=nothing)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(found)
