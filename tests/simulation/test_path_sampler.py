"""The path of a simulated run in a bounded number of points."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.path_sampler import PathSampler
from mcserver.simulation.simulation import simulate
from mcserver.simulation.tool_poses import ToolPoses

SQUARE = "G1010\nG01 X100 F6000\nG01 Y100\nG01 X0\nG01 Y0\n"


def test_the_path_of_a_square_goes_through_its_corners_and_names_its_lines() -> None:
    path = simulate(SQUARE, load_machine("cartesian"), path_points=1000).report["path"]
    (tip,) = path["tips"]
    points = np.array(tip["points"])
    assert tip["tool"] is None
    assert 300 < len(points) <= 1001
    for corner in ((0, 0, 0), (100, 0, 0), (100, 100, 0), (0, 100, 0)):
        assert np.abs(points - corner).max(axis=1).min() < 0.5
    assert points[-1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)
    # the first point is where the axes stand before
    assert sorted(set(path["lines"])) == [0, 2, 3, 4, 5]


def test_a_simulation_that_asks_for_no_path_has_none() -> None:
    assert "path" not in simulate(SQUARE, load_machine("cartesian")).report


@pytest.mark.parametrize("cycles", [1, 7, 5000])
def test_points_do_not_depend_on_how_cycles_arrive_and_stay_bounded(cycles: int) -> None:
    machine = load_machine("cartesian")
    sampler = PathSampler(machine, ToolPoses(machine, None), 200)
    angle = np.linspace(0.0, 60.0, 20_000)
    setpoint = np.zeros((len(angle), len(machine.axes)))
    setpoint[:, 0], setpoint[:, 1] = np.cos(angle), np.sin(angle)
    for first in range(0, len(angle), cycles):
        sampler.take(
            np.zeros(0), np.full(len(angle[first : first + cycles]), 3), setpoint[first : first + cycles]
        )
    points = np.array(sampler.path()["tips"][0]["points"])
    assert 50 <= len(points) <= 201
    assert np.hypot(points[:, 0], points[:, 1]) == pytest.approx(1000.0, abs=0.01)
    whole = PathSampler(machine, ToolPoses(machine, None), 200)
    whole.take(np.zeros(0), np.full(len(angle), 3), setpoint)
    assert len(whole.path()["tips"][0]["points"]) == len(points)


def test_a_machine_with_tools_has_a_path_for_each_tip() -> None:
    machine = load_machine("arm6")
    text = "G1010\nG1020 A20 B-10\n"
    path = simulate(text, machine, kinematics=build_kinematics(machine), path_points=100).report["path"]
    assert [tip["tool"] for tip in path["tips"]] == [1]
    assert np.ptp(np.array(path["tips"][0]["points"]), axis=0).max() > 1.0
