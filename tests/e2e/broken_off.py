"""A program that is broken off in its middle as its server is killed."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest
from mcclient import sync

from tests.e2e.servers import ServerProcess
from tests.machine_text import axes_text

LIMIT_S = 120.0
RECOVERY = "[recovery]\nsafe_axis = 2\nsafe_position = 40.0\napproach_velocity = 100.0\n"
PART = [
    *["G1010", "G94 F6000", "G00 Z10", "G00 X100 Y40", "G01 Z-5"],
    *["G01 X160 F600", "G01 X320 F6000", "G00 Z10"],
]


def mill(folder: Path) -> str:
    """Write the machine file; its path."""
    axes = axes_text(range(3), keys="min_position = -200.0\nmax_position = 500.0")
    path = folder / "mill.toml"
    path.write_text(f'[machine]\nname = "mill"\ncycle_hz = 250\n{axes}{RECOVERY}', "utf-8")
    return str(path)


def killed_in_line_6(server: ServerProcess) -> str:
    """Kill a server while a program runs, and start it again; the program's id."""
    with sync.Machine.connect("mill", server.endpoint) as machine:
        program = machine.program("part.nc")
        program.send_lines(PART)
        program.close()
        deadline = time.monotonic() + LIMIT_S
        while program.done_through < 5 or machine.status().axes.setpoint[0] < 105.0:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        server.end(signal.SIGKILL)
        server.start()
        return program.id


def stands_at_the_end(server: ServerProcess) -> None:
    with sync.Machine.connect("mill", server.endpoint) as machine:
        assert machine.status().axes.setpoint[:3] == pytest.approx((320.0, 40.0, 10.0), abs=0.05)
        assert machine.programs()[0].state == "finished"
