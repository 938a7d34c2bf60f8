"""Tools and inverse kinematics (D-50 to D-53), on a kinematics whose point stands where its joints do."""

import math

import numpy as np
import pytest

from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.semantics.tool_pose import keep_c
from mcserver.motion.canonical import FeedGroup, RapidGroup
from mcserver.motion.geometry.curves import SampledCurve
from mcserver.units import DEGREE
from tests.gcode.support import CARTESIAN, Gantries, Program, check, machine_of

POINT = machine_of(" ".join(f"{n}:linear" for n in range(10)), "3:0,1,2 6:3,4,5 7:5,6,7")
WRIST = machine_of("0:linear 1:linear 2:linear 3:rotary 4:rotary 5:rotary 6:linear", "1:0,1,2,3,4,5:ZYX")


def point(*lines: str, reach: float = math.inf) -> Program:
    program = Program(POINT, Gantries(POINT, reach=reach))
    program.run("F6000", *lines)
    return program


def wrist(*lines: str) -> Program:
    program = Program(WRIST, Gantries(WRIST))
    program.run("F6000", *lines)
    return program


def test_t_stands_alone_or_with_a_move_and_is_modal_until_g1050() -> None:
    program = point("T6")
    assert program.feed("G01 X10").axes == (3, 4, 5)
    assert program.feed("G01 T3 X10").axes == (0, 1, 2)
    assert program.feed("X20").axes == (0, 1, 2)
    program.run("G1050")
    assert program.feed("X25").axes == (0,)


def test_t_behind_the_words_of_its_command_holds_for_them() -> None:
    assert point().feed("G01 X10 T6").axes == (3, 4, 5)


def test_of_several_t_in_a_line_the_last_stays_in_force() -> None:
    program = point("G01 T3 X1 G01 T6 X1")
    assert program.interpreter.modal.tool == 6


def test_words_are_the_tools_coordinates_in_mm_or_inches() -> None:
    program = point("T3", "G01 X10 Y20", "G20 G01 Z1")
    assert [program.mm(axis) for axis in range(3)] == [10.0, 20.0, 25.4]


def test_a_left_out_word_keeps_its_last_commanded_value() -> None:
    program = point("T3", "G01 X10 Y20 Z30", "G01 Y5")
    assert [program.mm(axis) for axis in range(3)] == [10.0, 5.0, 30.0]


def test_increments_start_from_the_last_commanded_pose() -> None:
    program = point("T3", "G01 X10 Y20 Z30", "G01 U1", "G91", "G01 Y1 Z-1")
    assert [program.mm(axis) for axis in range(3)] == [11.0, 21.0, 29.0]


def test_after_a_direct_move_of_a_joint_the_pose_is_read_from_fk() -> None:
    program = point("T3", "G01 X10 Y20 Z30", "G1050 G01 X100", "T3 G01 V1")
    assert [program.mm(axis) for axis in range(3)] == [100.0, 21.0, 30.0]


def test_a_move_by_another_tool_that_shares_a_joint_counts_as_direct() -> None:
    program = point("G01 T6 X1 Y2 Z3", "G01 T7 X50", "G01 T6 U1")
    assert [program.mm(axis) for axis in (3, 4, 5)] == [2.0, 2.0, 50.0]


def test_the_length_of_a_tool_move_is_that_of_the_tools_path() -> None:
    line = point().motion("G01 T3 X30 Y40")
    (group,) = line.groups
    assert isinstance(group, FeedGroup)
    assert group.requested == pytest.approx(0.5)
    assert line.feed_length == pytest.approx(0.05)
    (curve,) = group.curves
    assert isinstance(curve, SampledCurve)
    assert curve.length == pytest.approx(0.05)
    assert np.allclose(
        curve.position(np.array([0.0, 0.4, 1.0])), [[0, 0, 0], [0.012, 0.016, 0], [0.03, 0.04, 0]]
    )


@pytest.mark.parametrize("plane", ["G17 G02 X10 Y10 R10", "G18 G02 X10 Z10 R10", "G19 G03 Y10 Z10 R10"])
def test_a_tools_arc_lies_in_its_plane_of_tool_coordinates(plane: str) -> None:
    program = point("T3")
    line = program.motion(plane)
    (group,) = line.groups
    assert isinstance(group, FeedGroup)
    (curve,) = group.curves
    points = curve.position(np.linspace(0.0, 1.0, 51))
    start, end = points[0], points[-1]
    assert np.allclose(start, 0.0, atol=1e-12)
    moved = np.flatnonzero(np.abs(end) > 1e-9)
    still = 3 - moved.sum()
    assert np.allclose(points[:, still], 0.0, atol=1e-12)
    bulge = np.abs(points[25, moved] - end[moved] / 2.0)
    assert bulge == pytest.approx([0.01 * (math.sqrt(0.5) - 0.5)] * 2, rel=2e-2)
    assert curve.length == pytest.approx(0.01 * math.pi / 2.0)


def test_a_tools_helix_and_circle() -> None:
    program = point("T3")
    assert program.motion("G03 Z5 I10 J0 P2").feed_length == pytest.approx(math.hypot(0.04 * math.pi, 0.005))
    assert program.motion("G03 I10 J0").feed_length == pytest.approx(0.02 * math.pi)


def test_rapid_with_a_tool_sends_the_joints_to_the_solved_target() -> None:
    line = point("T3", "G00 X1 Y1").motion("G00 X5 Z7")
    targets = pytest.approx((0.005, 0.001, 0.007))
    assert line.groups == (RapidGroup((0, 1, 2), targets, wait=True, carried=(3,)),)
    assert line.exact_stop


def test_a_tool_not_in_the_model_lists_those_that_are() -> None:
    for text in ("T5", "G01 T5 X1", "T3.5", "T-1"):
        (fault,) = point().faults(text)
        assert fault.code == "MC310"
        assert "T3, T6, T7" in fault.hint


def test_a_machine_without_tools_says_so_and_one_without_the_extra_too() -> None:
    (fault,) = Program(CARTESIAN).faults("T1")
    assert (fault.code, "no" in fault.hint or "none" in fault.hint) == ("MC310", True)
    (fault,) = Program(POINT).faults("G01 T3 X1")
    assert fault.code == "MC313"
    assert "T3, T6, T7" in fault.hint


def test_index_words_with_a_tool_are_refused_and_g1050_is_proposed() -> None:
    for text in ("G01 X1 [8]5", "G00 [0]5", "G1020 X5", "G1030 [8]5"):
        fault = point("T3").faults(text)[0]
        assert fault.code == "MC312"
        assert "G1050" in fault.hint


def test_a_tool_without_orientation_takes_no_angles() -> None:
    (fault,) = point("T3").faults("G01 X1 A5")
    assert (fault.code, fault.column) == ("MC311", 8)


def test_chains_of_two_tools_in_a_line_must_not_meet_another_command() -> None:
    assert point().codes("G01 T3 X1 G1050 G01 [1]5") == ["MC114"]
    assert point().codes("G01 T6 X1 G01 T7 X5") == ["MC114"]
    assert point().codes("G01 T3 X1, G01 T3 Y1") == ["MC114"]
    assert point().codes("G01 T3 X1 G01 T6 X5") == []


def test_a_point_out_of_reach_gives_tool_and_residual_and_nothing_moves() -> None:
    program = point("T3", reach=1.0)
    before = dict(program.interpreter.positions)
    (fault,) = program.faults("G01 X1250")
    assert (fault.code, fault.tool, fault.column, fault.end_column) == ("MC302", 3, 1, 10)
    assert fault.residual_mm == pytest.approx(250.0)
    assert dict(program.interpreter.positions) == before
    assert program.codes("G00 X1250") == ["MC302"]


def test_a_joint_limit_names_the_axis() -> None:
    (fault,) = point("G93 F60").faults("G01 T6 Z-11000")
    assert (fault.code, fault.axis, fault.tool) == ("MC303", 5, 6)


def test_a_tools_chain_must_be_leased() -> None:
    program = Program(POINT, Gantries(POINT), lease=frozenset({0, 1}))
    assert program.codes("G01 T3 X1 F100") == ["MC109"]


def test_angles_are_degrees_and_add_up() -> None:
    program = wrist("T1", "G01 X10 A10 B20 C30", "G91 G01 C15 X1")
    assert [program.deg(axis) for axis in (3, 4, 5)] == [10.0, 20.0, 45.0]


def test_a_move_that_only_turns_is_measured_in_degrees_of_the_rotation() -> None:
    program = wrist("T1", "G01 X10")
    line = program.motion("G01 C90 F360")
    (group,) = line.groups
    assert isinstance(group, FeedGroup)
    assert group.requested == pytest.approx(15.0)
    assert group.speed == pytest.approx(6.0 * DEGREE)
    assert group.curves[0].length == pytest.approx(90.0 * DEGREE)
    assert line.feed_length == 0.0


def test_a_move_that_turns_and_travels_is_measured_by_its_path() -> None:
    assert wrist("T1").feed("G01 X100 C90").requested == pytest.approx(1.0)


def test_orientation_goes_along_an_arc() -> None:
    program = wrist("T1")
    (group,) = program.motion("G02 X10 Y10 R10 C90").groups
    assert isinstance(group, FeedGroup)
    half = group.curves[0].position(np.array([0.5]))[0]
    assert half[5] == pytest.approx(45.0 * DEGREE)


def test_a_tool_move_without_travel_lasts_its_g93_time() -> None:
    program = point("T3", "G01 X5", "G93 F60")
    assert program.feed("G01 X5").requested == 1.0
    program = point("T3", "G01 X5")
    assert program.feed("G01 X5").requested == 0.0


def test_at_b_90_c_keeps_its_value_after_a_direct_move() -> None:
    program = wrist("T1", "G01 B90 C30", "G1050", "G93 F60", "G01 A-10 C20", "T1 G01 U1")
    a, c = program.deg(3), program.deg(5)
    assert c == 30.0
    assert a == pytest.approx(0.0, abs=1e-6)


def _matrix(order: str, angles: tuple[float, float, float]) -> np.ndarray:
    product = np.eye(3)
    for letter in order:
        k = "XYZ".index(letter)
        i, j = (k + 1) % 3, (k + 2) % 3
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = math.cos(angles[k])
        turn[j, i] = math.sin(angles[k])
        turn[i, j] = -math.sin(angles[k])
        product = product @ turn
    return product


@pytest.mark.parametrize("order", ["ZYX", "XYZ", "XZY", "YXZ", "YZX", "ZXY"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_keeping_c_keeps_the_orientation_in_every_order(order: str, sign: float) -> None:
    angles = [0.3, -0.7, 1.1]
    angles["XYZ".index(order[1])] = sign * math.pi / 2.0
    before = (angles[0], angles[1], angles[2])
    after = keep_c(before, 0.25, order)
    assert np.allclose(_matrix(order, before), _matrix(order, after))
    if order[1] != "Z":
        assert after[2] == 0.25


def test_away_from_b_90_the_angles_stay_as_they_are() -> None:
    assert keep_c((0.1, 0.2, 0.3), 9.0, "ZYX") == (0.1, 0.2, 0.3)


def test_the_tool_ends_with_the_program() -> None:
    program = point("T3", "M30")
    assert program.interpreter.modal.tool is None


def test_a_check_solves_tool_paths_and_goes_on_after_a_fault() -> None:
    lines = ["F6000", "T3", "G01 X1250", "G01 X10", "G01 Y2000", "T9", "G01 X5 [3]1", "G1050", "G01 [99]1"]
    assert check(*lines, machine=POINT, kinematics=Gantries(POINT, reach=1.0)) == [
        (3, "MC302"),
        (5, "MC302"),
        (6, "MC310"),
        (9, "MC108"),
    ]


def test_an_interpreter_resumed_with_a_tool_reads_its_pose_from_fk() -> None:
    program = point("T3", "G01 X10 Y20")
    resumed = Interpreter(
        POINT,
        kinematics=Gantries(POINT),
        modal=program.interpreter.modal,
        positions=program.interpreter.positions,
    )
    resumed.interpret_text("G01 U1", 1)
    assert resumed.positions[0] == pytest.approx(0.011)
