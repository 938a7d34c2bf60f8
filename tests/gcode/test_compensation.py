"""Cutter compensation (D-85), with the moves that LinuxCNC 2.9's rs274 gives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.errors import ProgramRejected
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import parse_machine
from mcserver.motion.canonical import FeedGroup, MotionLine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.units import MM
from tests.bench.rs274_contours import ContourWriter
from tests.bench.rs274_programs import MACHINE, moves_here
from tests.gcode.support import Program
from tests.machine_text import axes_text

_AXES = axes_text(range(3), keys="min_position = -100.0\nmax_position = 100.0")
WITH_TOOLS = parse_machine(
    f'[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n{_AXES}'
    "[[cutter]]\nnumber = 1\nlength_mm = 50.0\ndiameter_mm = 6.0\n[[cutter]]\nnumber = 2\nlength_mm = 40.0\n"
)
HEAD = "G21 G90 F1000"


def moves(*lines: str) -> list[tuple[float, ...]]:
    found, fault = moves_here("\n".join([HEAD, *lines]))
    assert not fault, fault
    return [tuple(round(value, 4) for value in move) for move in found]


def faults(*lines: str) -> list[tuple[str, int]]:
    return [(each.code, each.line) for each in check_program("\n".join([HEAD, *lines]), WITH_TOOLS)]


def test_outer_corners_are_rounded_and_the_way_in_ends_square_to_it() -> None:
    assert moves("G42.1 D6", "G1 X10 Y10", "X30", "Y20", "G40 X0 Y0") == [
        (11.2426, 7.0, 0.0),
        (30.0, 7.0, 0.0),
        (33.0, 10.0, 0.0, 30.0, 10.0),
        (33.0, 20.0, 0.0),
        (0.0, 0.0, 0.0),
    ]


def test_inner_corners_are_cut_off_where_the_paths_beside_them_meet() -> None:
    assert moves("G41.1 D4", "G1 Y10", "X20 Y10.0", "Y30", "X0 Y40", "G40 X0")[2:4] == [
        (18.0, 12.0, 0.0),
        (18.0, 28.7639, 0.0),
    ]


def test_arcs_have_another_radius_and_meet_lines_and_arcs() -> None:
    assert moves("G41.1 D6", "G2 X10 Y10 I5 J5", "G1 X30", "G40", "G0 X0") == [
        (11.0914, 13.0, 0.0, 6.0607, 6.0607),
        (30.0, 13.0, 0.0),
        (0.0, 10.0, 0.0),
    ]
    inner = moves("G41.1 D4", "G1 X10", "G3 X20 Y10 J10", "X10 Y20 I-10", "G40 G1 X0 Y0")
    assert inner[1:3] == [(18.0, 10.0, 0.0, 10.0, 10.0), (10.0, 18.0, 0.0, 10.0, 10.0)]


def test_what_stands_between_two_moves_comes_between_them_and_each_has_its_line() -> None:
    interpreter = Interpreter(MACHINE)
    found: list[tuple[int, int]] = []
    for number, text in enumerate(
        [HEAD, "G41.1 D2", "G1 X10", "Z-3", "S100", "Y-10", "X20", "G40", "G1 Z5", "G1 X0"], start=1
    ):
        for value in interpreter.interpret_text(text, number):
            found.append((number, value.line))
        assert interpreter.held_line == {3: 3, 4: 3, 5: 3, 6: 6, 7: 7}.get(number)
    # number of the line that was read, and of the one whose move comes
    assert found == [(6, 3), (6, 4), (6, 6), (7, 6), (8, 7), (9, 9), (10, 10)]


@pytest.mark.parametrize("end", ["M2", "M30", ""])
def test_the_last_move_comes_at_the_program_s_end(end: str) -> None:
    assert moves("G41.1 D2", "G1 X10", "X20", end)[-1] == (20.0, 1.0, 0.0)


def test_moves_out_of_the_plane_stay_beside_the_path() -> None:
    assert moves("G41.1 D2", "G1 X10", "X10 Z-3", "X20", "G40", "G0 Z5", "X0")[-4:] == [
        (10.0, 1.0, -3.0),
        (20.0, 1.0, -3.0),
        (20.0, 1.0, 5.0),
        (0.0, 0.0, 5.0),
    ]


def test_rapids_round_corners_on_the_arc_and_are_straight() -> None:
    assert moves("G41.1 D2", "G1 X10", "G0 Y-10", "X20", "G40 Y0")[1:3] == [
        (11.0, 0.0, 0.0, 10.0, 0.0),
        (11.0, -9.0, 0.0),
    ]


def test_feed_is_that_of_the_cutter_s_centre() -> None:
    values = Program(MACHINE).run(HEAD, "G42.1 D10", "G1 X10", "G3 X20 Y10 J10", "G40", "M2")
    arc = next(v for v in values if isinstance(v, MotionLine) and v.line == 4)
    group = arc.groups[0]
    assert isinstance(group, FeedGroup)
    length = math.pi / 2 * 15 * MM
    assert arc.feed_length == pytest.approx(length)
    assert group.requested == pytest.approx(length / (1000 * MM / 60))


@pytest.mark.parametrize(
    ("lines", "where"),
    [
        (["G1 X10", "G3 X14 Y4 I0 J4", "G1 X0"], 4),  # an arc of 4 mm, a radius of 5
        (["G1 X30", "Y4", "X0"], 4),  # a slot of 4 mm
    ],
)
def test_a_gouge_is_refused_at_its_line(lines: list[str], where: int) -> None:
    assert faults("G41.1 D10", *lines)[0] == ("MC169", where)


def test_the_diameter_is_that_of_the_tool_table() -> None:
    assert faults("T1 M6", "G42", "G1 X10", "X20", "G40 Y5") == [("MC154", 2)]
    assert faults("G41 D2", "G1 X10") == [("MC143", 2)]
    assert faults("G41 D7", "G1 X10") == [("MC143", 2)]
    assert faults("G10 L1 P2 R4", "G41 D2", "G1 X10", "G40 G1 X0") == []
    assert faults("G41.1", "G1 X10") == [("MC118", 2)]
    assert faults("G41.1 D[1.5*2]", "G1 X10", "G40 X0") == []


@pytest.mark.parametrize(
    "line",
    [
        "G42.1 D3",
        "G92 X0",
        "G28",
        "G10 L1 P1 R3",
        "G53 G0 X0",
        "G18",
        "M6 T2",
        "M0",
        "G81 Z-3 R1 X50",
        "G1010",
        "G93 G1 X50 F2",
        "G43 H1",
        "G1020 X50",
        "G1 X50, Y3",
        "G40 G42.1 D3",
    ],
)
def test_what_would_shift_the_path_is_refused(line: str) -> None:
    assert faults("G41.1 D2", "G1 X10", "X20", line, "X60", "G40 X0")[0] == ("MC170", 5)


def test_the_spindle_and_the_same_zero_go_on_under_compensation() -> None:
    assert faults("G41.1 D2", "G1 X10", "X20", "G54 M3 S100", "X60", "G40 X0") == [("MC142", 5)]


def test_a_check_goes_on_behind_a_fault() -> None:
    assert faults("G41.1 D2", "G1 X10", "X20 Q5", "X30", "X31", "Y-40", "G40 X0") == [("MC113", 4)]


def test_a_short_way_in_and_an_arc_out_are_refused() -> None:
    assert faults("G41.1 D20", "G1 X9") == [("MC170", 3)]
    assert faults("G41.1 D2", "G1 X9", "X20", "G40 G2 X30 I5") == [("MC170", 5)]
    assert faults("G41.1 D2", "G40", "G2 X30 I15") == []


def test_a_path_beside_the_programmed_one_stays_within_travel() -> None:
    assert faults("G41.1 D10", "G1 X10 Y97", "X50", "G40 Y0") == [("MC201", 4)]


def test_a_start_under_compensation_is_refused_and_names_its_line() -> None:
    lines = [HEAD, "G41.1 D2", "G1 X10", "X20", "G40", "X30", "X40"]
    for number, refused in ((2, False), (3, True), (4, True), (6, True), (7, False)):
        try:
            state_before(lines, number, MACHINE, StartState.of(MACHINE))
            assert not refused
        except ProgramRejected as rejected:
            (fault,) = rejected.diagnostics
            assert refused
            assert (fault.code, fault.line) == ("MC167", number)
            assert "line 2" in fault.hint


def test_a_line_that_is_refused_can_be_sent_again() -> None:
    program = Program(MACHINE)
    program.run(HEAD, "G41.1 D10", "G1 X20")
    assert program.codes("G3 X24 Y4 J4") == ["MC169"]
    assert program.interpreter.held_line == 3
    assert [value.line for value in program.run("Y-20")] == [3, 4]


@given(st.integers(0, 10**6))
def test_the_cutter_s_centre_keeps_its_distance_from_each_move(seed: int) -> None:
    text = ContourWriter(seed).program()
    if check_program(text, MACHINE):
        return
    radius = float(text.splitlines()[1].split("D")[1]) / 2.0
    interpreter, bare = Interpreter(MACHINE), Interpreter(MACHINE)
    plane = (0, 1) if "G17" in text else (2, 0)
    plain: dict[int, np.ndarray] = {}
    beside: list[tuple[int, np.ndarray]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        for value in interpreter.interpret_text(line, number):
            beside += _sampled(value, plane)
        for value in bare.interpret_text(line, number) if number != 2 else ():
            plain.update(_sampled(value, plane))
    for number, points in beside:
        # the way in and the way out cross the path; a corner's arc is about the move's start
        around = number in plain and np.ptp(np.linalg.norm(points - plain[number][0], axis=1)) < 1e-9
        if not around and number not in (min(plain), max(plain)):
            apart = np.linalg.norm(points[:, None, :] - plain[number][None, :, :], axis=2)
            assert apart.min() == pytest.approx(radius * MM, abs=2e-5)
            assert apart.min() > (radius - 0.001) * MM


def _sampled(value: object, plane: tuple[int, int]) -> list[tuple[int, np.ndarray]]:
    if not isinstance(value, MotionLine) or not isinstance(value.groups[0], FeedGroup):
        return []
    curve = value.groups[0].curves[0]
    if not set(plane) <= set(curve.axes):
        return []
    columns = [curve.axes.index(axis) for axis in plane]
    return [(value.line, curve.position(np.linspace(0.0, 1.0, 200))[:, columns])]
