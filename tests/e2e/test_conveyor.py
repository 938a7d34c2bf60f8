"""An arm that works on a belt that moves, by a real server: as its clients record it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.units import DEGREE
from tests.e2e.conftest import Mcctl, served
from tests.e2e.servers import ServerProcess
from tests.executor.test_tool_conveyor import ARM, BELT, FOLLOW, machine
from tests.limits import broken_limits, limits_of

PICK = """G1010
T1 G0 X460 Y-120 Z400 A0 B0 C0
G1050
G1030 [9]600
T1
G1060
G1 Z350 F12000
G04 P0.5
G1061
G0 X460 Y-120 Z400
G1050
G1030 [9]0
M2
"""


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[ServerProcess]:
    follow = FOLLOW.replace("MORE", "")
    text = ARM.replace('euler = "ZYX"\n', f'euler = "ZYX"\n{follow}').replace(
        "cycle_hz = 1000", "cycle_hz = 250"
    )
    file = tmp_path / "cell.toml"
    file.write_text(text + BELT, "utf-8")
    yield from served(tmp_path, str(file), "cell")


def test_the_tip_stands_on_the_piece_that_goes_on(cell: ServerProcess, mcctl: Mcctl, tmp_path: Path) -> None:
    target = ("--machine", "cell", "--connect", cell.endpoint)
    file, recorded = tmp_path / "pick.gcode", tmp_path / "pick.npz"
    file.write_text(PICK, "utf-8")
    ran = mcctl("run", str(file), "--record", str(recorded), *target)
    assert ran.returncode == 0, ran.stderr
    with np.load(recorded) as kept:
        joints, belt = DEGREE * kept["setpoint"][:, :6], kept["actual"][:, 6]
    made = machine()
    kinematics = build_kinematics(made)
    assert kinematics is not None
    tip = 1e3 * kinematics.tool(1).chain.forward(joints)[0]
    (down,) = np.nonzero(np.abs(tip[:, 2] - 350.0) < 1e-3)
    dwell = down[len(down) // 4 : len(down) // 2]
    assert np.ptp(tip[dwell, 1]) > 5.0
    assert np.ptp(tip[dwell, 1] - belt[dwell]) < 0.01
    assert math.dist(tip[-1], (460.0, -120.0, 400.0)) < 1e-3
    whole = np.array(limits_of(made, whole=True))[:, :6]
    assert broken_limits(joints, whole, 0.004) == []
