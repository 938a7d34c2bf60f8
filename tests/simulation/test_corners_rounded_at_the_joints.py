"""Corners of a tool's path within a tolerance at the joints, where that is quicker (D-36)."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from mcserver.machine.machine_file import load_machine, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.motion.geometry.curves import Array
from mcserver.simulation.simulation import Simulation, simulate
from tests.simulation.test_bends_of_tool_paths import distances, vertices

PATH_TOLERANCE_MM, SPEED_MM_S = 0.02, 100.0


def run(feed: str, angle: float, joint_tolerance_deg: float, *, exact: bool = False) -> Simulation:
    """Drive a zigzag with the built-in arm's tool."""
    arm = msgspec.structs.replace(
        load_machine("arm6"),
        path_tolerance=0.0 if exact else PATH_TOLERANCE_MM * 1e-3,
        joint_tolerance_angle=math.radians(joint_tolerance_deg),
    )
    kinematics = build_kinematics(arm)
    assert kinematics is not None
    start = 1000.0 * np.array(kinematics.pose(1, {a.index: a.initial_position for a in arm.axes}).position)
    lines = [f"G01 X{x:.4f} Y{y:.4f}" for x, y, _ in vertices(angle, start)[1:]]
    found = simulate("\n".join(["G1010", "T1", feed, *lines]), arm, kinematics=kinematics, record=True)
    assert found.report["ok"]
    return found


def took(found: Simulation) -> list[float]:
    return [round(line["end_s"] - line["start_s"], 6) for line in found.report["lines"]]


def joints(found: Simulation) -> Array:
    """Setpoints [deg]."""
    assert found.recording is not None
    return np.asarray(found.recording.setpoint, np.float64)


def tool_speed(rows: Array) -> float:
    """Greatest speed of the tool [mm/s]."""
    arm = load_machine("arm6")
    kinematics = build_kinematics(arm)
    assert kinematics is not None
    points = [kinematics.pose(1, dict(enumerate(row))).position for row in np.radians(rows).tolist()]
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).max()) * 1e6


@pytest.mark.parametrize(("angle", "tolerance"), [(45.0, 0.2), (120.0, 1.0)])
def test_a_corner_within_the_joints_tolerance_is_quicker_and_keeps_limits_and_f(
    angle: float, tolerance: float
) -> None:
    at_tool, at_joints = run("G94 F6000", angle, 0.0), run("G94 F6000", angle, tolerance)
    assert sum(took(at_joints)) < 0.95 * sum(took(at_tool))
    rows = joints(at_joints)
    assert tool_speed(rows) <= SPEED_MM_S * 1.001
    # rows of the exact path lie 0.02 degrees apart at most
    path = joints(run("G94 F6000", angle, 0.0, exact=True))
    path = path[np.append(True, np.abs(np.diff(path, axis=0)).max(axis=1) > 1e-6)]
    away = distances(rows, path)
    assert 0.1 * tolerance < away.max() <= tolerance
    assert (
        distances(path, rows[np.append(True, np.abs(np.diff(rows, axis=0)).max(axis=1) > 0.0)]).max()
        <= tolerance
    )
    arm = load_machine("arm6")
    rested = np.radians(np.concatenate([np.repeat(rows[:1], 3, 0), rows, np.repeat(rows[-1:], 3, 0)]))
    for order, name in ((1, "max_velocity"), (2, "max_acceleration"), (3, "max_jerk")):
        limit = np.array([getattr(axis, name) for axis in arm.axes])
        assert (np.abs(np.diff(rested, order, axis=0)) * 1000.0**order <= 1.05 * limit).all()


def test_a_line_that_keeps_its_time_stays_within_the_tolerance_at_the_tool() -> None:
    at_tool, at_joints = run("G93 F120", 45.0, 0.0), run("G93 F120", 45.0, 1.0)
    assert took(at_joints) == [0.5] * 4
    assert np.array_equal(joints(at_tool), joints(at_joints))


@pytest.mark.parametrize("value", ["-0.1", "31.0", "nan"])
def test_a_tolerance_at_the_joints_out_of_range_is_refused(value: str) -> None:
    text = f'[machine]\nname = "m"\n[motion]\njoint_tolerance_deg = {value}\n'
    with pytest.raises(MachineFileRejected) as refused:
        parse_machine(text)
    assert any("motion.joint_tolerance_deg" in each.message for each in refused.value.diagnostics)
