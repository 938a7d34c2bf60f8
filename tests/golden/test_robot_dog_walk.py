"""The reference's gait: two feet on lines, two on arcs, all together in 1 s a line (D-31, D-54)."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.simulation import Simulation, simulate
from mcserver.simulation.tool_poses import ToolPoses

Array = NDArray[np.float64]

GAIT = """\
G01 T3 X-159 Y-400 Z800 G01 T12 X159 Y-400 Z-100 G02 T6 Y-400 Z0 R500 G02 T9 Y-400 Z-800 R500
G01 T6 X159 Y-400 Z800 G01 T9 X-159 Y-400 Z-100 G02 T3 Y-400 Z0 R500 G02 T12 Y-400 Z-800 R500
"""
WALK = f"G1010\nG93 F60\n{GAIT * 3}"
FIRST, LAST = 3, 8
# hip [mm] and the side to which its leg stands off
HIPS = {3: (-99.0, 400.0, -1.0), 6: (99.0, 400.0, 1.0), 9: (-99.0, -450.0, -1.0), 12: (99.0, -450.0, 1.0)}
COLUMNS = {3: 0, 6: 3, 9: 6, 12: 9}
# of each foot: its x, where it is set down in front and behind
STROKES = {
    3: (-159.0, 800.0, 0.0),
    6: (159.0, 800.0, 0.0),
    9: (-159.0, -100.0, -800.0),
    12: (159.0, -100.0, -800.0),
}
# which feet are on the ground in the first line of the gait, going to the front
FORWARD_FIRST = (3, 12)


def foot(tool: int, setpoint: Array) -> Array:
    """The foot [mm], shape (N, 3), from all axes [deg]: hip about Z, 60 mm out thigh and knee about X."""
    hip_x, hip_z, side = HIPS[tool]
    hip, thigh, knee = np.radians(setpoint[:, COLUMNS[tool] : COLUMNS[tool] + 3]).T
    down = -350.0 * (np.cos(thigh) + np.cos(thigh + knee))
    along = -350.0 * (np.sin(thigh) + np.sin(thigh + knee))
    return np.stack(
        [
            hip_x + 60.0 * side * np.cos(hip) - down * np.sin(hip),
            60.0 * side * np.sin(hip) + down * np.cos(hip),
            hip_z + along,
        ],
        axis=1,
    )


@pytest.fixture(scope="module")
def walk() -> Simulation:
    machine = load_machine("robot-dog")
    return simulate(WALK, machine, kinematics=build_kinematics(machine), record=True)


@pytest.fixture(scope="module")
def recorded(walk: Simulation) -> Recorded:
    assert walk.recording is not None
    return walk.recording


def on_the_line(line: int, tool: int) -> bool:
    return (tool in FORWARD_FIRST) == (line % 2 == FIRST % 2)


def arc_centre(tool: int) -> Array:
    _, front, back = STROKES[tool]
    return np.array([-400.0 - np.sqrt(500.0**2 - (0.5 * (front - back)) ** 2), 0.5 * (front + back)])


def share_and_error(line: int, tool: int, points: Array) -> tuple[Array, Array]:
    """Share of its own path that a foot has covered, and its distance from it [mm], at each of the points."""
    x, front, back = STROKES[tool]
    if on_the_line(line, tool):
        share = (points[:, 2] - back) / (front - back)
        ideal = np.stack([np.full_like(share, x), np.full_like(share, -400.0), points[:, 2]], axis=1)
        return share, np.linalg.norm(points - ideal, axis=1)
    centre = arc_centre(tool)
    arm = points[:, 1:] - centre
    angle = np.arctan2(arm[:, 1], arm[:, 0])
    half = np.arcsin(0.5 * (front - back) / 500.0)
    error = np.hypot(np.linalg.norm(arm, axis=1) - 500.0, points[:, 0] - x)
    return (half - angle) / (2.0 * half), error


def test_each_line_of_the_gait_takes_its_second(walk: Simulation) -> None:
    lines = walk.report["lines"]
    assert [line["line"] for line in lines] == list(range(FIRST, LAST + 1))
    for line in lines:
        assert line["requested_s"] == 1.0
        assert line["end_s"] - line["start_s"] == pytest.approx(1.0, abs=1e-9)
        assert line["stretched_by"] == pytest.approx(1.0, abs=1e-9)
        assert line["bound_by"] is None


@pytest.mark.parametrize(("line", "tool"), list(itertools.product(range(FIRST, LAST + 1), HIPS)))
def test_a_foot_stays_on_its_line_or_arc_at_every_setpoint(recorded: Recorded, line: int, tool: int) -> None:
    rows = recorded.line == line
    share, error = share_and_error(line, tool, foot(tool, recorded.setpoint[rows]))
    assert error.max() <= 0.01
    assert share.min() == pytest.approx(0.0, abs=1e-4)
    assert share.max() == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("line", range(FIRST, LAST + 1))
def test_all_feet_have_covered_the_same_share_at_every_setpoint(recorded: Recorded, line: int) -> None:
    rows = recorded.setpoint[recorded.line == line]
    shares = np.array([share_and_error(line, tool, foot(tool, rows))[0] for tool in HIPS])
    assert np.ptp(shares, axis=0).max() <= 1e-4


@pytest.mark.parametrize(("tool", "apex"), [(3, -200.0), (6, -200.0), (9, -257.07), (12, -257.07)])
def test_an_arc_lifts_its_foot_to_the_apex(recorded: Recorded, tool: int, apex: float) -> None:
    assert foot(tool, recorded.setpoint)[:, 1].max() == pytest.approx(apex, abs=0.01)


def test_no_foot_goes_below_the_ground(recorded: Recorded) -> None:
    assert min(foot(tool, recorded.setpoint)[:, 1].min() for tool in HIPS) >= -400.01


def test_the_walk_ends_where_it_began(recorded: Recorded) -> None:
    np.testing.assert_allclose(recorded.setpoint[-1], recorded.setpoint[0], atol=1e-3)


def test_the_recorded_poses_are_the_feet(recorded: Recorded) -> None:
    machine = load_machine("robot-dog")
    with_tools = recorded.with_tools(machine, ToolPoses(machine, build_kinematics(machine)))
    assert tuple(with_tools.tools) == (3, 6, 9, 12)
    for tool, poses in with_tools.tools.items():
        assert poses.shape == (len(recorded.time_s), 6)
        np.testing.assert_allclose(poses[:, :3], foot(tool, recorded.setpoint), atol=1e-6)
