"""The server killed in mid-run of a program with G1010 first: one call goes on, by SDK and ``mcctl``."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcclient import sync

from tests.e2e.conftest import Mcctl
from tests.e2e.servers import ServerProcess

LIMIT_S = 120.0
RECOVERY = "[recovery]\nsafe_axis = 2\nsafe_position = 40.0\napproach_velocity = 100.0\n"
PART = [
    *["G1010", "G94 F6000", "G00 Z10", "G00 X100 Y40", "G01 Z-5"],
    *["G01 X300 F600", "G01 X320 F6000", "G00 Z10"],
]


def mill(folder: Path) -> str:
    axes = "".join(
        f'[[axis]]\nindex = {index}\ntype = "linear"\nmax_velocity = 200.0\nmax_acceleration = 2000.0\n'
        "min_position = -200.0\nmax_position = 500.0\n"
        for index in range(3)
    )
    path = folder / "mill.toml"
    path.write_text(f'[machine]\nname = "mill"\ncycle_hz = 250\n{axes}{RECOVERY}', "utf-8")
    return str(path)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[ServerProcess]:
    made = ServerProcess(tmp_path, mill(tmp_path), "mill")
    made.start()
    yield made
    made.close()


def killed_in_line_6(server: ServerProcess) -> str:
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


def test_mcctl_shows_the_way_and_goes_on(server: ServerProcess, mcctl: Mcctl) -> None:
    name = killed_in_line_6(server)
    target = ("--machine", "mill", "--connect", server.endpoint)
    shown = mcctl("continue", "--show", "--json", *target)
    assert shown.returncode == 0, shown.stderr
    answer = json.loads(shown.stdout)
    assert (answer["program"], answer["line"], answer["done"], answer["needs"]) == (name, 6, 5, [])
    assert answer["way"][0] == "lift: Z to 40.000 mm, slowly"
    done = mcctl("continue", *target)
    assert (done.returncode, done.stdout) == (0, "mill: finished, lines through 8 are done\n"), done.stderr
    assert ">     6 | G01 X300 F600" in done.stderr
    stands_at_the_end(server)
    again = mcctl("continue", *target)
    assert again.returncode != 0
    assert "no program was broken off" in again.stderr
