"""A machine that has to be homed, from its file to a program that runs, with real processes."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e.conftest import Mcctl, served
from tests.e2e.servers import ServerProcess

# travel in mm; the probe meets the work at X10
MACHINE = """
[machine]
name = "lathe"
[[input]]
number = 4
name = "touch"
[probe]
input = 4
simulated_at = { X = 10.0 }
[[axis]]
index = 0
type = "linear"
max_velocity = 200.0
max_acceleration = 2000.0
min_position = 0.0
max_position = 300.0
[axis.homing]
method = "switch"
velocity = 50.0
latch_velocity = 5.0
position = -2.0
then_move_to = 5.0
[axis.drive]
home_switch = [-1000.0, -10.0]
initial_position = 20.0
[[axis]]
index = 2
type = "linear"
max_velocity = 200.0
max_acceleration = 2000.0
[axis.homing]
method = "absolute"
"""


@pytest.fixture
def lathe(tmp_path: Path) -> Iterator[ServerProcess]:
    file = tmp_path / "lathe.toml"
    file.write_text(MACHINE, "utf-8")
    yield from served(tmp_path, str(file), "lathe")


def test_home_then_run_then_probe_then_restart(lathe: ServerProcess, mcctl: Mcctl, tmp_path: Path) -> None:
    target = ("--machine", "lathe", "--connect", lathe.endpoint)
    file = tmp_path / "part.gcode"
    file.write_text("G1010\nG94 F6000 G01 X50\nG38.2 X0 F1200\nM02\n", "utf-8")
    refused = mcctl("run", str(file), *target)
    assert refused.returncode == 1, refused.stderr
    assert "MC450" in refused.stderr
    homed = mcctl("home", "--all", *target)
    assert homed.returncode == 0, homed.stderr
    assert "X at 5.000 mm" in homed.stdout
    assert "X: slowly to it again" in homed.stderr
    done = mcctl("reference", "Z", "-12.5", *target)
    assert "Z at -12.500 mm" in done.stdout, done.stderr
    ran = mcctl("run", str(file), *target)
    assert ran.returncode == 0, ran.stderr
    status = json.loads(mcctl("status", "--json", *target).stdout)
    assert status["axes"]["homed"] == [True, True]
    assert status["probe"]["tripped"]
    assert status["probe"]["positions"]["0"] == pytest.approx(10.0, abs=1e-3)
    lathe.end(signal.SIGTERM)
    lathe.start()
    again = json.loads(mcctl("status", "--json", *target).stdout)
    assert again["axes"]["homed"] == [False, True]
    assert again["axes"]["position"][1] == pytest.approx(-12.5)
