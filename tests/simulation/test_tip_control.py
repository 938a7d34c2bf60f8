"""G43.4 on machines from a URDF alone, held against forward kinematics of the test's own (D-86)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.canonical import FeedGroup, MotionLine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.simulation.simulation import simulate
from tests.machine_text import axes_text
from tests.motion.measure import from_polyline

from .five_axes import (
    HEAD_HEAD,
    HEAD_TABLE,
    TABLE_TABLE,
    FiveAxes,
    assert_within_limits,
    at_end,
    reader,
    rows,
    run,
    tips,
)

ROOT = Path(__file__).parents[2]
# of the corners, and of the path between them [mm]
TOLERANCE, PATH = 0.02, 0.01
ROTARY = {id(TABLE_TABLE): (3, 5), id(HEAD_TABLE): (4, 5), id(HEAD_HEAD): (4, 5)}
BEGIN = "G10 L2 P1 X5 Y-7 Z-200\nG54 G64\nG43.4 H1"


@pytest.mark.parametrize("mill", [TABLE_TABLE, HEAD_TABLE, HEAD_HEAD], ids=["tables", "mixed", "heads"])
def test_the_tip_keeps_its_line_on_the_work_piece_and_its_feed_while_rotary_axes_turn(
    mill: FiveAxes, tmp_path: Path
) -> None:
    machine = mill.machine(tmp_path, tolerance=TOLERANCE)
    first, second = ROTARY[id(mill)]
    random = np.random.default_rng(5)
    corners = np.array([[0.0, 0.0, 60.0], *np.round(random.uniform((-30, -30, 0), (30, 30, 60), (8, 3)), 3)])
    turns = np.round(random.uniform([-35, -80], [35, 80], (9, 2)), 3)
    text = [BEGIN]
    for number, (point, turn) in enumerate(zip(corners, turns, strict=True)):
        words = "X{:.3f} Y{:.3f} Z{:.3f}".format(*point)
        words += f" {'XYZABC'[first]}{turn[0]:.3f} {'XYZABC'[second]}{turn[1]:.3f}"
        text.append(f"{'G0' if number == 0 else 'G1 F900'} {words}")
    found = run(machine, "\n".join(text))
    assert found.recording is not None
    positions = rows(found, machine)
    points = tips(mill, positions)
    feeding = found.recording.line > 4
    assert from_polyline(points[feeding], corners) <= TOLERANCE + PATH
    assert np.abs(points[-1] - corners[-1]).max() < 1e-6
    assert [positions[axis][-1] for axis in (first, second)] == pytest.approx(turns[-1], abs=1e-9)
    speed = np.linalg.norm(np.diff(points[feeding], axis=0), axis=1) * 1000.0 * 60.0
    assert speed.max() <= 900.0 * 1.001
    assert np.median(speed) == pytest.approx(900.0, rel=0.01)
    assert_within_limits(found, machine)


@pytest.mark.parametrize("mill", [TABLE_TABLE, HEAD_HEAD], ids=["tables", "heads"])
def test_chords_flow_as_one_curve_within_the_tolerance_and_the_feed_at_the_tip(
    mill: FiveAxes, tmp_path: Path
) -> None:
    machine = mill.machine(tmp_path, tolerance=TOLERANCE)
    first, second = ("XYZABC"[axis] for axis in ROTARY[id(mill)])
    t = 0.02 * np.arange(200)
    corners = np.round(np.stack([25 * np.sin(t), 20 * np.sin(1.3 * t), 30 + 10 * np.sin(0.7 * t)], axis=1), 4)
    turns = np.round(np.stack([20 * np.sin(0.9 * t), 40 * np.sin(0.6 * t)], axis=1), 4)
    lines = [
        f"G1 X{x} Y{y} Z{z} {first}{a} {second}{b}"
        for (x, y, z), (a, b) in zip(corners.tolist(), turns.tolist(), strict=True)
    ]
    found = run(machine, "\n".join([BEGIN, "F1800", lines[0].replace("G1", "G0"), *lines[1:]]))
    assert found.recording is not None
    points = tips(mill, rows(found, machine))
    feeding = found.recording.line > 5
    assert from_polyline(points[feeding], corners) <= TOLERANCE + PATH
    assert (np.linalg.norm(np.diff(points[feeding], axis=0), axis=1) * 6e4).max() <= 1800.0 * 1.001
    asked = float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum()) / 30.0
    assert feeding.sum() * 0.001 <= 1.05 * asked
    assert_within_limits(found, machine)


def test_the_feed_at_the_tip_is_kept_where_all_axes_go_far_for_a_short_way_of_it(trunnion: Machine) -> None:
    lines = [
        f"G1 X{30 + 0.04 * k:.4f} Y{0.02 * k:.4f} Z60 A{4 * np.sin(0.1 * k):.4f} C{4 * np.sin(0.08 * k):.4f}"
        for k in range(1, 150)
    ]
    found = run(trunnion, "\n".join([BEGIN, "G64 P0.05", "G0 X30 Y0 Z60", "F100", *lines]))
    assert found.recording is not None
    points = tips(TABLE_TABLE, rows(found, trunnion))
    speed = np.linalg.norm(np.diff(points[found.recording.line > 6], axis=0), axis=1) * 6e4
    assert speed.max() <= 100.0 * 1.002


def test_rotary_axes_go_evenly_along_the_line_and_a_rapid_is_straight(tmp_path: Path) -> None:
    machine = TABLE_TABLE.machine(tmp_path)
    found = run(machine, f"{BEGIN}\nG0 X40 Y0 Z20 A-30 C60\nG1 X-20 Y30 Z40 A10 C-90 F600")
    assert found.recording is not None
    positions = rows(found, machine)
    points = tips(TABLE_TABLE, positions)
    for number, begin, end in ((4, (0, 0, 0), (40, 0, 20)), (5, (40, 0, 20), (-20, 30, 40))):
        line = found.recording.line == number
        a = points[line][0] if number == 4 else np.array(begin, dtype=float)
        b = np.array(end, dtype=float)
        assert from_polyline(points[line], np.array([a, b])) <= PATH
        share = (points[line] - a) @ (b - a) / ((b - a) @ (b - a))
        for axis in (3, 5):
            q = positions[axis][line]
            assert (
                np.abs(q - (q[0] + (share - share[0]) / (share[-1] - share[0]) * (q[-1] - q[0]))).max() < 0.02
            )
    assert_within_limits(found, machine)


def tip_of(machine: Machine, found: Interpreter) -> list[float]:
    return [round(each, 6) for each in tips(TABLE_TABLE, at_end(machine, found))[0].tolist()]


def test_words_left_out_keep_the_tip_on_the_work_piece_and_increments_count_from_it(
    trunnion: Machine,
) -> None:
    found = reader(trunnion, BEGIN, "F500", "G1 X10 Y20 Z30", "A-20 C45")
    assert tip_of(trunnion, found) == [10.0, 20.0, 30.0]
    found.interpret_text("G91 X1 Z-2 C10", 7)
    assert tip_of(trunnion, found) == [11.0, 20.0, 28.0]
    assert np.degrees(found.positions[5]) == pytest.approx(55.0)


def test_parameters_of_the_position_read_the_tip(trunnion: Machine) -> None:
    found = run(
        trunnion, f"{BEGIN}\nG1 X10 Y20 Z30 A-20 C45 F900\nG1 X[#5420 + 1] Y[#<_y> - 2] Z[#5422] C[#5425]"
    )
    positions = rows(found, trunnion)
    points = tips(TABLE_TABLE, positions)
    assert points[-1] == pytest.approx([11.0, 18.0, 30.0], abs=1e-6)
    assert positions[5][-1] == pytest.approx(45.0)


def test_with_rotary_axes_at_zero_words_mean_what_they_mean_under_g43(trunnion: Machine) -> None:
    """Where C has a zero of its own in G54, there."""
    begin = "G10 L2 P1 X5 Y-7 Z-200 C30\nG54 F500\nG1 C0"
    by_length = reader(trunnion, begin, "G43 H1\nG1 X10 Y20 Z30").positions
    by_tip = reader(trunnion, begin, "G43.4 H1\nG1 X10 Y20 Z30").positions
    assert by_tip == pytest.approx(by_length, abs=1e-12)
    behind = reader(trunnion, begin, "G43.4 H1\nG1 X10 Y20 Z30 A-20\nG49\nG1 Z35").positions
    assert behind[2] == pytest.approx(-0.165)


def test_arcs_lie_on_the_work_piece_and_g93_gives_their_time(trunnion: Machine) -> None:
    text = f"{BEGIN}\nG0 X20 Y0 Z10\nG93 G17 G3 X-20 Y0 I-20 J0 A-25 C40 F30"
    found = run(trunnion, text)
    assert found.recording is not None
    points = tips(TABLE_TABLE, rows(found, trunnion))
    last = found.recording.line == 5
    assert np.abs(np.hypot(points[last, 0], points[last, 1]) - 20.0).max() <= PATH
    assert np.abs(points[last, 2] - 10.0).max() <= PATH
    (line,) = (each for each in found.report["lines"] if each["line"] == 5)
    assert line["end_s"] - line["start_s"] == pytest.approx(2.0, abs=0.002)


def test_a_start_from_a_line_under_it_goes_on_as_the_whole_program(trunnion: Machine) -> None:
    lines = [*BEGIN.splitlines(), "G1 X10 Y0 Z20 A-10 C20 F500", "X20 A-20", "Y15 C-40", "X0 Z25"]
    kinematics = build_kinematics(trunnion)
    state = state_before(lines, 6, trunnion, StartState.of(trunnion), kinematics=kinematics)
    resumed = Interpreter(trunnion, kinematics=kinematics, positions=state.positions, modal=state.modal)
    whole = reader(trunnion, *lines[:5])
    for number in (6, 7):
        curves = []
        for each in (resumed, whole):
            (value,) = each.interpret_text(lines[number - 1], number)
            assert isinstance(value, MotionLine)
            (group,) = value.groups
            assert isinstance(group, FeedGroup)
            curves.append(group.curves[0].position(np.linspace(0.0, 1.0, 9)))
        assert np.abs(curves[0] - curves[1]).max() < 1e-12


@pytest.mark.parametrize(
    "line",
    [
        "G28 X0",
        "G53 G0 Z0",
        "G81 Z-5 R2",
        "G41 D1",
        "M6 T1",
        "G92 X0",
        "G10 L20 P1 X0",
        "G1020 X5",
        "G1 [0]5",
    ],
)
def test_what_reads_or_sets_axes_is_refused_under_it(trunnion: Machine, line: str) -> None:
    found = reader(trunnion, BEGIN, "F500")
    with pytest.raises(ProgramRejected) as rejected:
        found.interpret_text(line, 5)
    assert "MC172" in [each.code for each in rejected.value.diagnostics]


def test_a_machine_that_cannot_do_it_says_what_it_lacks(trunnion: Machine, tmp_path: Path) -> None:
    def refused(machine: Machine, *lines: str) -> tuple[str, str]:
        with pytest.raises(ProgramRejected) as rejected:
            reader(machine, *lines)
        (fault,) = rejected.value.diagnostics
        return fault.code, f"{fault.message}; {fault.hint}"

    plain = parse_machine(f'[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n{axes_text(range(3))}')
    code, said = refused(plain, "G43.4")
    assert code == "MC171"
    assert "urdf" in said
    assert "[[tool]]" in said
    assert refused(trunnion, "G43.4 H7")[0] == "MC143"
    code, said = refused(trunnion, BEGIN, "G0 Z900")
    assert code == "MC303"
    assert "axis 2" in said
    robot = TABLE_TABLE.machine(tmp_path, dialect='profile = "robot"')
    assert refused(robot, "G43.4 H1")[0] == "MC141"


def test_the_example_runs_and_a_rotary_axis_past_its_travel_is_one_fault_at_its_word() -> None:
    machine = load_machine(str(ROOT / "examples" / "trunnion-mill.toml"))
    text = (ROOT / "examples" / "five-axis.gcode").read_text("utf-8")
    found = simulate(text, machine, kinematics=build_kinematics(machine))
    assert found.report["ok"], found.report["diagnostics"]
    with pytest.raises(ProgramRejected) as rejected:
        reader(machine, BEGIN, "F500", "G1 X5 A-200")
    (fault,) = rejected.value.diagnostics
    assert (fault.code, fault.axis, fault.column) == ("MC201", 3, 7)
