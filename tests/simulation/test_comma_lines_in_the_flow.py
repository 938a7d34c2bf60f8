"""Comma lines flow: groups of one T together, of several T the one that ends last (D-32)."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import Simulation, simulate
from tests.motion.support import AxisSpec, machine_of

MACHINE = machine_of(
    [AxisSpec(500.0, 2000.0, 50_000.0)] * 2 + [AxisSpec(360.0, 5000.0, 100_000.0, rotary=True)]
)


def run(lines: list[str]) -> Simulation:
    return simulate("\n".join(["G1010", *lines]), MACHINE, record=True)


def speeds_at_ends(found: Simulation) -> list[float]:
    """Speed of the first axis where each line but the last one ends [mm/s]."""
    assert found.recording is not None
    x = found.recording.setpoint[:, 0]
    ends = [round(line["end_s"] * 1000.0) for line in found.report["lines"][:-1]]
    return [float(x[end + 1] - x[end]) * 1000.0 for end in ends if end > 0]


def test_comma_groups_of_one_time_go_on_without_a_stop_and_keep_it() -> None:
    found = run(["G93 F60", *(f"G01 X{50 * n}, G01 [2]{90 * n}" for n in range(1, 5))])
    assert [line["stretched_by"] for line in found.report["lines"]] == pytest.approx([1.0] * 4, abs=1e-12)
    assert min(speeds_at_ends(found)) > 30.0


def test_comma_groups_whose_speeds_give_one_time_flow_under_g94() -> None:
    found = run(["G94", *(f"G01 F3000 X{50 * n}, G01 F5400 [2]{90 * n}" for n in range(1, 5))])
    assert np.allclose(speeds_at_ends(found), 50.0, rtol=1e-3)


def test_the_group_that_ends_last_goes_on_without_a_stop_and_the_other_rests() -> None:
    found = run(["G93", *(f"G01 F60 X{50 * n}, G01 F120 [2]{90 * n}" for n in range(1, 4))])
    assert np.allclose(speeds_at_ends(found), 50.0, rtol=1e-3)
    assert [round(line["end_s"] - line["start_s"], 6) for line in found.report["lines"]] == [1.0] * 3
    assert found.recording is not None
    turning = found.recording.setpoint[:, 2]
    for line, number in zip(found.report["lines"], range(1, 4), strict=True):
        half = round((line["start_s"] + 0.5) * 1000.0)
        assert turning[half + 2 : half + 480] == pytest.approx(90.0 * number, abs=1e-9)


def test_a_group_of_the_time_of_another_ends_with_it_and_does_not_stop() -> None:
    lines = [f"G01 X{10 * n} F6000, G01 Y{9.8 * n} F6000" for n in range(1, 5)]
    flowing, resting = run(["G94", *lines]), run(["G94 G61", *lines])
    took = [line["end_s"] - line["start_s"] for line in flowing.report["lines"]]
    # Y from rest to rest
    assert np.allclose(took, 0.188, atol=5e-4)
    assert min(speeds_at_ends(flowing)) > 40.0
    assert flowing.report["lines"][-1]["end_s"] < resting.report["lines"][-1]["end_s"]


def test_groups_whose_times_are_out_of_reach_flow_in_that_of_the_shorter_one() -> None:
    # from rest to rest X takes 0.19 s and the rotary axis 0.17 s, whatever is asked for
    lines = [f"G01 X{10 * n} F600, G01 [2]{15 * n} F900" for n in range(1, 5)]
    flowing, resting = run(["G93", *lines]), run(["G93 G61", *lines])
    took = [line["end_s"] - line["start_s"] for line in flowing.report["lines"]]
    assert max(took) < 0.95 * min(line["end_s"] - line["start_s"] for line in resting.report["lines"])
    assert min(speeds_at_ends(flowing)) > 40.0
    assert [line["bound_by"] for line in flowing.report["lines"]] == ["axis 2 jerk"] * 4


def test_axes_that_change_from_leading_to_ending_early_rest_between_the_lines() -> None:
    found = run(["G94 F6000", "G01 X100, G01 [2]5", "G01 X110, G01 [2]95", "G01 X210, G01 [2]100"])
    assert max(speeds_at_ends(found)) < 1.0


def test_a_plain_line_flows_into_and_out_of_a_comma_line() -> None:
    found = run(["G94 F3000", "G01 X50", "G01 X100, G01 [2]9 F5400", "G01 X150 F3000"])
    assert np.allclose(speeds_at_ends(found), 50.0, rtol=1e-3)


def test_comma_groups_under_an_exact_stop_rest_at_both_ends() -> None:
    found = run(["G61 G93", *(f"G01 F60 X{50 * n}, G01 F120 [2]{90 * n}" for n in range(1, 4))])
    assert max(speeds_at_ends(found)) < 1.0


def test_a_tool_whose_corners_are_rounded_at_the_joints_ends_no_line_before_the_other_tool() -> None:
    dog = msgspec.structs.replace(load_machine("robot-dog"), path_tolerance=1e-4, joint_tolerance_angle=0.05)
    kinematics = build_kinematics(dog)
    lines = [
        f"G01 T3 X-159 Y{-400 + 10 * (n % 2)} Z{30 * n} F6000, G01 T6 X159 Y-400 Z{800 - 20 * n} F2500"
        for n in range(1, 4)
    ]
    found = simulate("\n".join(["G1010", "G94", *lines]), dog, kinematics=kinematics, record=True)
    assert found.report["ok"]
    took = [line["end_s"] - line["start_s"] for line in found.report["lines"]]
    # the slower tool's 20 mm
    assert min(took) >= 0.48 - 1e-6
    assert found.recording is not None
    speeds = np.abs(np.diff(found.recording.setpoint, axis=0)).max(axis=1) * 1000.0
    ends = [round(line["end_s"] * 1000.0) for line in found.report["lines"][:-1]]
    assert min(speeds[end] for end in ends) > 3.0
