"""What nobody asked for fails: strange motion, crawling, rests; wrong answers made by chance are caught."""

from __future__ import annotations

from random import Random

import pytest
from mcbenchmark.families import machine_file
from mcbenchmark.generated import generated_tasks
from mcbenchmark.judge import judge, same_motion
from mcbenchmark.mutations import mutants
from mcbenchmark.tasks import Expectation, Leg, Task, shipped_tasks
from mcbenchmark.trial import try_judge
from mcbenchmark.verdict import Check

SHIPPED = {task.id: task for task in shipped_tasks()}


@pytest.mark.parametrize(
    ("task", "text", "check"),
    [
        # a plunge on the way, before the first leg, behind the last one
        ("square", "G1010\nG94 F6000\nG01 X20\nG00 Z-100\nG00 Z0\nG01 Y20\nX0\nY0\n", Check.PATH),
        ("line-at-a-speed", "G1010\nG94 F6000\nG00 Z-100\nG01 X30 Y40\nG00 Z0\n", Check.PATH),
        ("quarter-arc", "G1010\nG94 F6000\nG03 X20 Y20 R20 G01 Z-100\n", Check.STRAY),
        # 2 mm/s for 100, all the way and for the half of it
        ("triangle-in-space", "G1010\nG94 F120\nG01 X10 Z5\nY12 Z0\nX0 Y0\n", Check.PATH),
        ("line-at-a-speed", "G1010\nG94 F120\nG01 X15 Y20\nF6000\nX30 Y40\n", Check.PATH),
        # a rapid of an axis that nobody asked for, in its own time and in step
        ("line-at-a-speed", "G1010\nG94 F6000\nG1020 [7]90\nG01 X30 Y40\n", Check.STRAY),
        (
            "only-two-energized",
            "G1010\nG94 F6000\nG01 X10\nG00 [8]5\nG1011\nG1010 P0\nG1010 P1\n",
            Check.STRAY,
        ),
        ("circle-with-the-arm", "G1010\nG94 F9000\nG17 G02 T1 I10 J0 Z655 P1\n", Check.PATH),
        ("one-joint", "G1010\nG94 F6000\nG01 [0]10\nG00 [5]-80\n", Check.STRAY),
        # a rest that nobody asked for
        ("relative-and-back", "G1010\nG94 F6000\nG91 G01 X10 Y-5\nG04 P2\nG90 G01 X30 Y0\n", Check.PATH),
        # by less than the tolerance of what was asked for
        ("spin-and-stop", "G1030 [3]-120\nG04 P0.3\nG1030 [3]0\nG04 P0.1\nG00 X3\n", Check.STRAY),
        # there and back on the way of an axis that only its end is named of
        ("rapid-of-many-axes", "G1010\nG00 Z20\nG00 X30 Z-10 [3]90 [7]-45\n", Check.STRAY),
    ],
)
def test_what_nobody_asked_for_fails(task: str, text: str, check: Check) -> None:
    assert check in {each.check for each in judge(SHIPPED[task], text).findings}


@pytest.mark.parametrize(
    ("task", "text"),
    [
        (
            "square",
            "Sure:\n\n```gcode\nG1010\nG94 F6000\nG61\nG01 X20\nY20\nX0\nY0\n```\nIt is a square.",
        ),
        ("line-at-a-speed", "The program:\n\nG1010\nG94 F6000\nG01 X30 Y40\n\nThis moves along a line.\n"),
        ("full-circle", "G1010 (power)\nG94 F9000\nG02 X0 Y0 I15 J0\nM30\n"),
        ("staircase", "G1010\nG94 F6000\nG01 X106\nY-46\nX112\nY-42\nX118\nY-38\n"),
        ("around-a-clamp", "G1010\nG94 F12000\nG61\nG01 Y-15\nX40\nY0\n"),
        ("over-a-wall", "G1010\nG64 G94 F12000\nG01 X5 Z12\nX25\nX30 Z0\n"),
    ],
)
def test_another_right_answer_passes_with_prose_around_it_too(task: str, text: str) -> None:
    assert judge(SHIPPED[task], text).findings == ()


def test_every_wrong_answer_made_of_shipped_and_generated_tasks_is_caught() -> None:
    # a part of them by each run of the tests: `mcbenchmark --mutants 1000` is all of them
    trial = try_judge((*SHIPPED.values(), *generated_tasks(38, "trial")), 60, seed=7)
    assert (trial.wrong, trial.missed, trial.refused) == (60, (), ())


def test_a_judge_that_lets_a_wrong_answer_pass_is_found_out() -> None:
    task = Task(
        "lax", "lax", "cartesian", "", Expectation(), "G1010\nG94 F6000\nG01 X5 Y5\n", (("X5", "X6"),)
    )
    trial = try_judge([task], 20, seed=1)
    assert trial.caught < 1.0
    assert {each.task for each in trial.missed} == {"lax"}


def test_a_wrong_answer_differs_from_the_solution_and_is_made_again_by_its_seed() -> None:
    task = SHIPPED["pocket"]
    texts = [each.text for each, _ in zip(mutants(task, Random(3)), range(50), strict=False)]
    assert task.solution not in texts
    assert texts == [each.text for each, _ in zip(mutants(task, Random(3)), range(50), strict=False)]


def test_the_same_motion_written_otherwise_is_no_wrong_answer() -> None:
    task = SHIPPED["line-at-a-speed"]
    assert same_motion(task, task.solution, "g1010\ng94 f600\ng1 f6000 y40 x30")
    assert not same_motion(task, task.solution, "G1010\nG94 F6000\nG01 X30 Y40.1")


def test_clearance_is_a_law_of_a_task() -> None:
    legs = (Leg({"X": 250, "Z": 0}, detour=True),)
    expect = Expectation(path=legs, clear_mm=5, within={"Z": (0, 60)})
    task = Task("vise", "vise", machine_file("mill"), "", expect, "", (("", ""),))
    over = "G90 G94 F6000\nG01 Z{}\nX250\nZ0\n"
    assert judge(task, over.format(8)).findings == ()
    (near,) = judge(task, over.format(4)).findings
    assert "clearance is 4 mm, asked is at least 5 mm" in near.message
    assert judge(task, over.format(0)).findings[0].message.startswith("MC320")
