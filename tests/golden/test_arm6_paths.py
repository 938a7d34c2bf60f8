"""The six-axis arm from G-code to setpoints: a line and a circle in each plane, with a turn on the way."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import Simulation, simulate
from tests.golden.urdf_tips import tips

Array = NDArray[np.float64]

HOME = np.array([460.0, 0.0, 675.0])
LINE = 3
MACHINE = load_machine("arm6")
KINEMATICS = build_kinematics(MACHINE)
# a circle: code, where its centre is from the start, the plane's normal, the angles A B C at its end
CIRCLES = {
    "XY": ("G17 G02 I40 J0 C20", (40.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 20.0)),
    "ZX": ("G18 G02 I40 K0 B10", (40.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 10.0, 0.0)),
    "YZ": ("G19 G02 J40 K0 A10", (0.0, 40.0, 0.0), (1.0, 0.0, 0.0), (10.0, 0.0, 0.0)),
}


def run(command: str) -> Simulation:
    simulation = simulate(f"G1010\nG93 F20 T1\n{command}\n", MACHINE, kinematics=KINEMATICS, record=True)
    assert simulation.exit_code == 0, simulation.report["diagnostics"]
    return simulation


def tip_of(simulation: Simulation) -> tuple[Array, Rotation]:
    """The tip at each setpoint of the line [mm]."""
    assert simulation.recording is not None
    joints = simulation.recording.setpoint[simulation.recording.line == LINE]
    points, turns = tips("arm6.urdf", "tip", np.radians(joints))
    return points * 1000.0, turns


def largest_turn_error(turns: Rotation, angles: tuple[float, float, float], share: Array) -> float:
    """Largest angle to the one turn from A0 B0 C0 to ``angles``, in proportion to the path (D-51) [deg]."""
    # A0 B0 C0 is the tool straight down; ZYX is Rz(C) Ry(B) Rx(A)
    end = Rotation.from_euler("ZYX", angles[::-1], degrees=True)
    ideal = Rotation.from_rotvec(share[:, None] * end.as_rotvec())
    return float(np.degrees((turns * ideal.inv()).magnitude().max()))


def test_a_line_with_a_turn_keeps_point_and_orientation() -> None:
    simulation = run("G01 X500 Y100 Z600 A10 B-15 C30")
    points, turns = tip_of(simulation)
    way = np.array([500.0, 100.0, 600.0]) - HOME
    share = (points - HOME) @ way / (way @ way)
    assert np.linalg.norm(points - HOME - share[:, None] * way, axis=1).max() <= 0.01
    assert share[-1] == pytest.approx(1.0, abs=1e-4)
    assert largest_turn_error(turns, (10.0, -15.0, 30.0), share) <= 0.01


@pytest.mark.parametrize("plane", CIRCLES)
def test_a_circle_with_a_turn_keeps_point_and_orientation(plane: str) -> None:
    command, offset, normal, angles = CIRCLES[plane]
    points, turns = tip_of(run(command))
    arm = -np.asarray(offset)
    # clockwise as seen from the normal's end (D-22)
    side = np.cross(arm, normal)
    from_centre = points - (HOME + offset)
    angle = np.unwrap(np.arctan2(from_centre @ side, from_centre @ arm))
    ideal = np.cos(angle)[:, None] * arm + np.sin(angle)[:, None] * side
    assert np.linalg.norm(from_centre - ideal, axis=1).max() <= 0.01
    assert angle[-1] - angle[0] == pytest.approx(2.0 * np.pi, abs=1e-3)
    assert largest_turn_error(turns, angles, (angle - angle[0]) / (2.0 * np.pi)) <= 0.01


@pytest.mark.parametrize(
    "command", ["G01 X500 Y100 Z600 A10 B-15 C30", *(each[0] for each in CIRCLES.values())]
)
def test_a_tool_move_takes_the_time_that_it_asks_for(command: str) -> None:
    (line,) = run(command).report["lines"]
    assert line["end_s"] - line["start_s"] == pytest.approx(3.0, abs=1e-9)
    assert line["stretched_by"] == pytest.approx(1.0, abs=1e-9)
