"""The judge says why an answer fails, whatever the answer is."""

from __future__ import annotations

import pytest
from mcbenchmark.attempts import Attempt
from mcbenchmark.baselines import Baseline, answer_by
from mcbenchmark.judge import MAX_ANSWER, codes_of, judge
from mcbenchmark.judge_process import JudgeProcess
from mcbenchmark.scores import Tried, as_json, by_category, score
from mcbenchmark.tasks import Expectation, Leg, Task, shipped_tasks
from mcbenchmark.verdict import Check


def task(expect: Expectation, machine: str = "cartesian", limit_s: float = 2.0) -> Task:
    return Task("a-task", "mine", machine, "Move.", expect, "G1010", (("G1010", ""),), limit_s=limit_s)


def checks(text: str, expect: Expectation | None = None, **others: float) -> list[Check]:
    return [each.check for each in judge(task(expect or Expectation(), **others), text).findings]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "check"),
    [
        ("", Check.ANSWER),
        (" \n\n", Check.ANSWER),
        ("X1 " * MAX_ANSWER, Check.ANSWER),
        ("\n" * 5000 + "G1010", Check.ANSWER),
        ("I would move X to 10.", Check.REJECTED),
        ("\x00\ud800", Check.REJECTED),
        ("G01 X1 F600", Check.FAULT),
        ("G04 P1e3", Check.REJECTED),
        ("G04 P1000000", Check.ENDLESS),
        ("G1010\nF1\nG01 X100", Check.ENDLESS),
    ],
)
def test_what_is_no_program_fails_with_a_reason(text: str, check: Check) -> None:
    assert set(checks(text)) == {check}


def test_the_time_limit_is_of_simulated_time() -> None:
    assert checks("G04 P0.5", limit_s=0.1) == [Check.ENDLESS]
    assert checks("G04 P0.5", limit_s=1.0) == []


def test_codes_in_comments_do_not_count() -> None:
    used = Expectation(uses=("G20|G21",), lacks=("G91",))
    assert checks("G1010 (G20)\n; G21\n% title 20\n", used) == [Check.CODES]
    assert checks("g1010\ng021 ; G91\n", used) == []


def test_codes_are_found_in_any_spelling() -> None:
    assert codes_of("g1 t03 X1, G 1020 [7]5\n(G91)\nN5 m0") == [
        {"G01", "T3", "X", "G1020", "[7]"},
        set(),
        {"N", "M00"},
    ]


def test_lines_of_code_are_counted_without_comments() -> None:
    assert checks("; a\n\nG1010\n; b", Expectation(max_lines=1)) == []
    assert checks("G1010\nG90", Expectation(max_lines=1)) == [Check.CODES]


def test_every_part_that_does_not_fit_is_a_reason() -> None:
    expect = Expectation(
        path=(Leg({"X": 5}),),
        end={"Y": 1},
        duration_s=(1, 2),
        avoid=({"X": (-1, 1)},),
        within={"Y": (5, 6)},
        released=(0,),
    )
    found = checks("G1010\nG00 X3", expect)
    assert found == [Check.PATH, Check.ZONE, Check.END, Check.ZONE, Check.DURATION, Check.AXES]


def test_a_task_for_axes_that_the_machine_lacks_fails_with_their_names() -> None:
    (finding,) = judge(task(Expectation(end={"40": 1})), "G1010").findings
    assert "no axis 40" in finding.message


def test_random_answers_depend_on_the_seed_and_the_task_alone() -> None:
    first, second = shipped_tasks()[:2]
    assert answer_by(Baseline.RANDOM, first, 1) == answer_by(Baseline.RANDOM, first, 1)
    assert answer_by(Baseline.RANDOM, first, 1) != answer_by(Baseline.RANDOM, first, 2)
    assert answer_by(Baseline.RANDOM, first, 1) != answer_by(Baseline.RANDOM, second, 1)


def test_the_template_joins_the_places_of_the_prompt() -> None:
    (square,) = (each for each in shipped_tasks() if each.id == "line-at-a-speed")
    assert answer_by(Baseline.TEMPLATE, square, 1) == "G1010\nG94 F6000\nG01\nX0 Y0\nX30 Y40\n"
    assert judge(square, answer_by(Baseline.TEMPLATE, square, 1)).passed


def test_scores_count_by_category() -> None:
    lines, arcs = shipped_tasks()[0], shipped_tasks()[5]
    verdicts = [judge(lines, lines.solution), judge(arcs, "")]
    assert (score(verdicts).passed, score(verdicts).share) == (1, 0.5)
    assert {name: each.passed for name, each in by_category(verdicts).items()} == {"lines": 1, "arcs": 0}
    shown = as_json([Tried((Attempt((each,), ("",), 0.5, 1, 2),)) for each in verdicts], "shipped")
    assert shown["results"][1]["findings"] == [{"check": "answer", "message": "there is no program"}]
    assert (shown["score"], shown["pass_at"], shown["tokens"]) == (
        0.5,
        {"1": 0.5},
        {"prompt": 2, "answer": 4},
    )
    assert score([]).share == 0.0


def test_an_answer_that_takes_the_judge_too_long_fails_and_the_next_one_is_judged() -> None:
    done = shipped_tasks()[0]
    with JudgeProcess(judging_s=0.01) as hasty:
        (finding,) = hasty.judge(done, done.solution).findings
        assert finding.check is Check.ENDLESS
    with JudgeProcess() as patient:
        assert patient.judge(done, done.solution).passed
