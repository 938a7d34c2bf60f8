"""Chords of an arm's and of legs' tools: one curve within the tolerance, under F and under T (D-36, D-54)."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from mckinematics.rotation import euler_to_matrix, rotation_vectors

from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.canonical import FeedGroup, MotionLine
from mcserver.motion.geometry.curves import SampledCurve, TipLine
from mcserver.simulation.simulation import simulate
from tests.limits import broken_limits, limits_of
from tests.simulation.test_bends_of_tool_paths import distances

TOLERANCE, OWN = 0.1, 0.01
RADIUS, SPEED, TILT = 40.0, 50.0, 8.0
START = np.array([460.0, 0.0, 600.0])


def circle(chord: float, *, tilt: float = 0.0) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Lines along a circle, its points [mm] and A B C [deg], shapes (n+1, 3)."""
    count = round(2.0 * math.pi * RADIUS / chord)
    angle = 2.0 * math.pi * np.arange(count + 1) / count
    points = START + RADIUS * np.column_stack((np.cos(angle) - 1.0, np.sin(angle), np.zeros(count + 1)))
    turns = tilt * np.column_stack((np.sin(angle), 1.0 - np.cos(angle), np.zeros(count + 1)))
    points, turns = np.round(points, 4), np.round(turns, 4)
    lines = [
        f"G01 X{x:.4f} Y{y:.4f} Z{z:.4f} A{a:.4f} B{b:.4f} C{c:.4f}"
        for (x, y, z), (a, b, c) in zip(points[1:].tolist(), turns[1:].tolist(), strict=True)
    ]
    return lines, points, turns


def arm(tolerance: float = TOLERANCE) -> Machine:
    return msgspec.structs.replace(load_machine("arm6"), path_tolerance=tolerance * 1e-3)


@pytest.mark.parametrize("tilt", [0.0, TILT])
@pytest.mark.parametrize("chord", [0.5, 2.0])
@pytest.mark.parametrize("timed", [False, True])
def test_chords_of_an_arm_flow_within_the_tolerance(chord: float, tilt: float, timed: bool) -> None:
    machine = arm()
    kinematics = build_kinematics(machine)
    assert kinematics is not None
    lines, points, turns = circle(chord, tilt=tilt)
    length = float(np.linalg.norm(points[1] - points[0]))
    feed = f"G93 F{60.0 * SPEED / length:.6f}" if timed else f"G94 F{60.0 * SPEED:g}"
    first = "G01 T1 X460 Y0 Z600 A0 B0 C0 F3000"
    text = "\n".join(["G1010", first, *[f"{line} {feed}" for line in lines]])
    found = simulate(text, machine, kinematics=kinematics, record=True)
    assert found.report["ok"], found.report["diagnostics"]
    assert found.recording is not None
    every = np.radians(found.recording.setpoint)
    assert not broken_limits(every, limits_of(machine))
    joints = every[found.recording.line > 2]
    poses = [kinematics.pose(1, dict(enumerate(row))) for row in joints.tolist()]
    tip = 1000.0 * np.array([pose.position for pose in poses])
    assert distances(tip[::5], points).max() <= TOLERANCE + OWN
    speed = np.linalg.norm(np.diff(tip, axis=0), axis=1) / machine.cycle_s
    assert speed[200:-200].min() > 0.97 * SPEED
    if not timed:
        assert speed.max() <= 1.001 * SPEED
    nearest = [int(np.linalg.norm(points - place, axis=1).argmin()) for place in tip[200:-200:40]]
    for pose, at in zip(poses[200:-200:40], nearest, strict=True):
        turned = euler_to_matrix(pose.angles, "ZYX") @ euler_to_matrix(np.radians(turns[at]), "ZYX").T
        off = math.degrees(float(np.linalg.norm(rotation_vectors(turned[None])[0])))
        # between two points the turn goes on by half a chord's share
        assert off <= TOLERANCE + OWN + 0.51 * tilt * length / RADIUS


@pytest.mark.parametrize("tolerance", [0.0, TOLERANCE])
def test_a_short_line_of_a_tool_is_a_line_of_its_joints_where_a_tolerance_lets_it_bow(
    tolerance: float,
) -> None:
    machine = arm(tolerance)
    interpreter = Interpreter(machine, kinematics=build_kinematics(machine))
    interpreter.interpret_text("G94 F3000", 1)
    kinds = []
    for number, words in enumerate(("T1 X459.5", "T1 X300 Y200", "T1 X299.5 A0.2"), 2):
        (line,) = interpreter.interpret_text(f"G01 {words}", number)
        assert isinstance(line, MotionLine)
        (group,) = line.groups
        assert isinstance(group, FeedGroup)
        kinds.append(type(group.curves[0]))
    short = TipLine if tolerance else SampledCurve
    assert kinds == [short, SampledCurve, short]


@pytest.mark.parametrize("exact", ["G61", "G09"])
def test_an_exact_stop_is_along_the_tools_own_path(exact: str) -> None:
    machine = arm(5.0)
    kinematics = build_kinematics(machine)
    assert kinematics is not None
    points = START + np.array([[0.0, 0.0, 0.0], [0.0, 40.0, 0.0], [-10.0, 80.0, 0.0]])
    words = [f"G01 X{x:g} Y{y:g} Z{z:g}" for x, y, z in points.tolist()]
    first, *lines = (f"{exact} {line}" for line in words)
    found = simulate(
        "\n".join(["G1010", "T1 F6000", first, *lines]), machine, kinematics=kinematics, record=True
    )
    assert found.recording is not None
    joints = np.radians(found.recording.setpoint[found.recording.line > 3])
    tip = 1000.0 * np.array([kinematics.pose(1, dict(enumerate(row))).position for row in joints.tolist()])
    assert distances(tip, points).max() <= OWN


def test_a_curve_whose_bends_are_closer_than_its_chords_keeps_f_at_the_tip() -> None:
    machine = arm(0.5)
    kinematics = build_kinematics(machine)
    assert kinematics is not None
    lines = [f"G01 Y{0.5 * index:g} Z{601 if index % 4 == 0 else 600}" for index in range(1, 25)]
    text = "\n".join(["G1010", "F300", "G01 T1 X460 Y0 Z600", *lines])
    found = simulate(text, machine, kinematics=kinematics, record=True)
    assert found.recording is not None
    joints = np.radians(found.recording.setpoint)
    tip = 1000.0 * np.array([kinematics.pose(1, dict(enumerate(row))).position for row in joints.tolist()])
    assert np.linalg.norm(np.diff(tip, axis=0), axis=1).max() / machine.cycle_s <= 1.001 * 5.0


@pytest.mark.parametrize(("name", "tool", "home"), [("cartesian", "", 0.0), ("robot-dog", "T3 ", -159.0)])
def test_a_run_far_shorter_than_the_tolerance_is_no_detour(name: str, tool: str, home: float) -> None:
    machine = msgspec.structs.replace(load_machine(name), path_tolerance=5e-4)
    kinematics = build_kinematics(machine)
    index = np.arange(1, 20)
    places = home - 0.001 * index + 0.0001 * (index % 3 == 1)
    lines = [
        f"G01 {tool}X{x:.5f}" if tool else f"G01 X{x:.5f} Y{1e-4 * (n % 2):.5f}" for n, x in enumerate(places)
    ]
    first = ["G1010", "G94 F300"]
    whole = simulate("\n".join([*first, lines[-1]]), machine, kinematics=kinematics).report["duration_s"]
    found = simulate("\n".join([*first, *lines]), machine, kinematics=kinematics).report["duration_s"]
    assert found <= whole + 2.0 * machine.cycle_s


def test_chords_of_four_feet_in_one_line_flow() -> None:
    dog = msgspec.structs.replace(load_machine("robot-dog"), path_tolerance=TOLERANCE * 1e-3)
    kinematics = build_kinematics(dog)
    assert kinematics is not None
    start = {axis.index: axis.initial_position for axis in dog.axes}
    homes = {tool: 1000.0 * np.array(kinematics.pose(tool, start).position) for tool in kinematics.tools}
    count, lines = 36, ["G1010", "G93"]
    for angle in 2.0 * math.pi * np.arange(2 * count + 1) / count:
        off = 20.0 * np.array([math.sin(angle), 0.0, 1.0 - math.cos(angle)])
        words = [
            f"G01 T{tool} X{x:.4f} Y{y:.4f} Z{z:.4f} F3000"
            for tool, (x, y, z) in ((tool, (home + off).tolist()) for tool, home in homes.items())
        ]
        lines.append(", ".join(words))
    found = simulate("\n".join(lines), dog, kinematics=kinematics, record=True)
    assert found.report["ok"], found.report["diagnostics"]
    assert found.recording is not None
    rates = np.abs(np.diff(found.recording.setpoint[found.recording.line > 3], axis=0)).max(axis=1) * 1000.0
    assert rates[60:-60].min() > 1.0
