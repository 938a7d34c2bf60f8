"""Which lines are taken as one run, what it holds, what ends it, and how far ahead it reads."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mcserver.gcode.fast_path.interpreted_batch import MIN_LINES
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.motion.canonical import PathBatch, RapidGroup
from tests.gcode.run_programs import NO_NUMBERS
from tests.gcode.support import Program


def started(*lines: str) -> Interpreter:
    program = Program()
    program.run(*lines)
    return program.interpreter


def taken(interpreter: Interpreter, texts: list[str], number: int = 100, most: int = 4096) -> int:
    found = interpreter.interpret_batch(texts, number, most)
    return 0 if found is None else found.taken


@pytest.mark.parametrize("number", NO_NUMBERS)
def test_what_the_dialect_does_not_read_as_a_number_ends_a_run(number: str) -> None:
    texts = [f"X{index}" for index in range(20)]
    texts[15] = f"X{number}"
    assert taken(started("F100 G01"), texts) == 15


@pytest.mark.parametrize(
    "number", ["5", "+5", "-5", ".5", "5.", "-.5", "+5.", "005", "5\t", " 5", "5 (five)", "5;", "5 F7"]
)
def test_what_the_dialect_reads_as_a_number_does_not_end_a_run(number: str) -> None:
    texts = [f"X{index}" for index in range(20)]
    texts[15] = f"X{number}"
    assert taken(started("F100 G01"), texts) == 20


OTHERS = (
    *(
        "G02 X1 Y1",
        "G02 X1 Y1 R5 I1",
        "G02 X1 Y1 R0",
        "(MSG, hello)",
        "X1 (debug, here)",
        "G00 X1 P1",
        "T1",
        "M00",
        "X1, Y1",
        "N5",
        "%",
        "G91 X1",
        "X1 F0",
        "X9000",
        "U1",
    ),
    *("5 X1", "- X1", "X", "N X1", "N1.5 X1", "N-1 X1", "G X1", "G1.0 X1", "G+1 X1", "G11 X1", "G0001 X1"),
    *(
        "X1 X2",
        "X1 [0]2",
        "[64]1",
        "[ ]1",
        "F5 X1 F6",
        "X1 F",
        "X1 N5",
        "X1 (",
        "X1)",
        "X1 ((a))",
        "X1 (a (b) ; c)",
        "x1 \u017f",
    ),
)


@pytest.mark.parametrize("line", OTHERS)
def test_other_lines_end_a_run(line: str) -> None:
    texts = [f"X{index}" for index in range(20)]
    texts[15] = line
    assert taken(started("F100 G01"), texts) == 15


def test_a_run_holds_lines_numbers_points_and_times() -> None:
    found = started("G94 F6000").interpret_batch(["G01 X0 Y0", "", *["X3 Y4", "X0 Y0 F3000"] * 6], 2)
    assert found is not None
    (run,), lines = found.values, found.taken
    assert isinstance(run, PathBatch)
    assert lines == 14
    assert run.lines.tolist() == [2, *range(4, 16)]
    assert run.axes == (0, 1)
    assert run.points[:4].tolist() == [[0.0, 0.0], [0.0, 0.0], [0.003, 0.004], [0.0, 0.0]]
    assert run.travels[:3] == pytest.approx([0.0, 0.005, 0.005])
    assert run.speeds is not None
    assert run.speeds[:4].tolist() == [0.1, 0.1, 0.05, 0.05]
    assert run.requested[:4] == pytest.approx([0.0, 0.05, 0.1, 0.1])


def test_lines_and_arcs_of_any_words_are_one_run() -> None:
    lines = [
        "G01 X0 Y0 Z1",
        "G02 X4 I2",
        "(said)",
        "X6 Y-2 J-2",
        "G01 Y-9",
        "Z-1 F3000",
        "G03 X9 Y-9 Z0 R1.5",
    ]
    found = started("G94 F6000").interpret_batch([*lines, *["G1 X1", "Y2"] * 6, "G04 P1", "X1"], 2)
    assert found is not None
    (run,), taken = found.values, found.taken
    assert isinstance(run, PathBatch)
    assert taken == len(lines) + 12
    assert run.lines[:4].tolist() == [2, 3, 5, 6]
    assert run.axes == (0, 1, 2)
    assert run.points[:4] * 1000 == pytest.approx(np.array([[0, 0, 0], [0, 0, 1], [4, 0, 1], [6, -2, 1]]))
    assert [run.frames[frame] for frame in run.frame[:6]] == [
        (0, 1, 2),
        (0, 1),
        (0, 1),
        (1,),
        (2,),
        (0, 1, 2),
    ]
    assert run.centres[[1, 2, 5]] * 1000 == pytest.approx(np.array([[2, 0], [4, -2], [7.5, -9]]))
    assert run.sweeps[:6] == pytest.approx([0, -math.pi, -math.pi / 2, 0, 0, math.pi])
    assert run.lengths[5] * 1000 == pytest.approx(math.hypot(1.5 * math.pi, 1))
    assert run.speeds is not None
    assert run.speeds[3:6].tolist() == [0.1, 0.05, 0.05]
    assert run.first_beyond({0, 1}) == (2, (0, 1, 2))
    assert run.first_beyond({0, 1, 2}) is None


@pytest.mark.parametrize("blank", ["", "; the tools", "(what it is)", " \t"])
def test_many_blank_lines_are_no_run(blank: str) -> None:
    assert taken(started("F100 G01"), [blank] * 40) == 0
    assert taken(started("F100 G01"), [*[blank] * 40, "5 X1", "G5 X1"], most=42) == 0
    assert taken(started("F100 G01"), [*[blank] * 14, *["X1", "Y2"] * 6]) == 26


@pytest.mark.parametrize("message", ["(MSG, look)", "X1 (msg,look)", "; (PRINT, 5)"])
def test_what_a_line_says_to_the_operator_is_not_lost_in_a_run(message: str) -> None:
    assert taken(started("F100 G01"), [*["X1"] * 15, message, *["X2"] * 15]) == 15


@pytest.mark.parametrize(
    "before",
    [
        ["F100"],  # no motion code to repeat
        ["F100 G02"],
        ["G01"],  # no feed
        ["F100 G01 G93"],  # nor here
        ["F100 G01", "G09"],
        ["F100 G01", "G1010 P0"],  # the encoder decides where X starts
        ["F100 G01", "M30"],
    ],
)
def test_where_a_line_is_not_simple_there_is_no_run(before: list[str]) -> None:
    assert taken(started(*before), ["X1"] * 20) == 0


def test_no_more_lines_are_taken_than_asked_for() -> None:
    texts = ["X1"] * 40
    assert taken(started("F100 G01"), texts, most=15) == 15
    assert taken(started("F100 G01"), texts, most=MIN_LINES - 1) == 0
    assert taken(started("F100 G01"), texts[: MIN_LINES - 1]) == 0


def test_looking_in_vain_pauses_and_a_run_takes_more_next_time() -> None:
    interpreter = started("F100 G01")
    first = interpreter.batch_window(100)
    assert taken(interpreter, ["X1"] * first, 100) == first
    assert interpreter.batch_window(100 + first) > first
    vain = ["X1", "G04 P0"] * 20
    assert taken(interpreter, vain, 200) == 0
    assert interpreter.batch_window(200) == 0
    assert interpreter.batch_window(201) > 0
    assert taken(interpreter, vain, 201) == 0
    assert interpreter.batch_window(202) == 0
    assert interpreter.batch_window(203) == first


def test_a_capture_keeps_runs_away_from_its_own_axes_only() -> None:
    assert taken(started("F100 G01", "G1010 P1"), ["X1"] * 20) == 20
    assert taken(started("F100 G01", "G1010 P1"), ["X1 Y1"] * 20) == 0
    assert taken(started("F100 G01", "G1010", "X1 Y1"), ["X1 Y1"] * 20) == 20


def test_rapids_stand_between_the_runs_of_their_lines() -> None:
    texts = ["G00 X1 Y2", *["G01 X3", "Y4"] * 6, "G0 Z5", "G01 X1", "X2"]
    found = started("F600").interpret_batch(texts, 2)
    assert found is not None
    assert found.taken == len(texts)
    kinds = [type(value).__name__ for value in found.values]
    assert kinds == ["MotionLine", "PathBatch", "MotionLine", "MotionLine", "MotionLine"]
    (group,) = found.values[0].groups
    assert group == RapidGroup((0, 1), (0.001, 0.002), True)
