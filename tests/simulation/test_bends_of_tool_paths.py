"""Bends of a tool's path: passed with speed, within the tolerance at the tool (D-36)."""

from __future__ import annotations

import dataclasses
import itertools
import math

import msgspec
import numpy as np
import pytest

from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import Simulation, simulate

TOLERANCE, LEG, LINES = 0.1, 40.0, 4


def machine() -> Machine:
    arm = load_machine("arm6")
    changed = {"path_tolerance": TOLERANCE * 1e-3}
    if isinstance(arm, msgspec.Struct):
        return msgspec.structs.replace(arm, **changed)
    return dataclasses.replace(arm, **changed)


def vertices(angle: float, start: np.ndarray) -> np.ndarray:
    """A zigzag in the plane of X and Y [mm]."""
    points, heading = [start], math.pi / 2.0
    for number in range(LINES):
        step = LEG * np.array([math.cos(heading), math.sin(heading), 0.0])
        points.append(np.round(points[-1] + step, 4))
        heading += math.radians(angle) * (1 if number % 2 == 0 else -1)
    return np.array(points)


def distances(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance of points from a polyline [mm]."""
    found = np.full(len(points), np.inf)
    for a, b in itertools.pairwise(corners):
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(points - (a + along[:, None] * (b - a)), axis=1))
    return found


@pytest.mark.parametrize(("feed", "angle"), [("G94 F6000", 10.0), ("G94 F6000", 15.0), ("G93 F120", 12.0)])
def test_a_bend_of_a_tool_path_is_no_stop_and_stays_within_the_tolerance(feed: str, angle: float) -> None:
    arm = machine()
    kinematics = build_kinematics(arm)
    assert kinematics is not None
    start = 1000.0 * np.array(kinematics.pose(1, {a.index: a.initial_position for a in arm.axes}).position)
    corners = vertices(angle, start)
    lines = [f"G01 X{x:.4f} Y{y:.4f}" for x, y, _ in corners[1:]]
    found: Simulation = simulate(
        "\n".join(["G1010", "T1", feed, *lines]), arm, kinematics=kinematics, record=True
    )
    assert found.report["ok"]
    assert found.recording is not None
    joints = np.radians(found.recording.setpoint)
    tool = 1000.0 * np.array([kinematics.pose(1, dict(enumerate(row))).position for row in joints.tolist()])
    assert distances(tool, corners).max() <= TOLERANCE
    nearest = [int(np.linalg.norm(tool - corner, axis=1).argmin()) for corner in corners[1:-1]]
    speed = np.linalg.norm(np.diff(tool, axis=0), axis=1) * 1000.0
    assert min(speed[at - 1] for at in nearest) > 70.0
    if feed.startswith("G94"):
        assert speed.max() <= 100.0 * 1.001
    else:
        assert [round(line["end_s"] - line["start_s"], 6) for line in found.report["lines"]] == [0.5] * LINES
    rows = np.concatenate([np.repeat(joints[:1], 3, 0), joints, np.repeat(joints[-1:], 3, 0)])
    jerk = np.abs(np.diff(rows, 3, axis=0)) * 1e9
    assert (jerk <= 1.05 * np.array([axis.max_jerk for axis in arm.axes])).all()
