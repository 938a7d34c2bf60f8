"""Several attempts and turns: pass@k, repair, and tokens."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import pytest
from mcbenchmark.answers import Answer
from mcbenchmark.attempts import Attempt, attempt, tokens_in
from mcbenchmark.cli import run
from mcbenchmark.scores import Tried, pass_at, passed_within
from mcbenchmark.tasks import Task, shipped_tasks
from mcbenchmark.verdict import Check, Finding, Verdict

TASK = shipped_tasks()[0]
RIGHT = Verdict("a", "b")
WRONG = Verdict("a", "b", (Finding(Check.PATH, "is not reached"),))


def tried(*attempts: tuple[Verdict, ...]) -> Tried:
    return Tried(tuple(Attempt(each, ("",) * len(each), 0.0, 0, 0) for each in attempts))


def test_an_attempt_ends_with_the_first_right_answer_and_is_told_what_was_wrong() -> None:
    prompts: list[str] = []

    def answerer(_number: int, _task: Task, prompt: str) -> Answer:
        prompts.append(prompt)
        return Answer(["G1", "G2", "G3"][len(prompts) - 1], duration_s=1.0)

    found = attempt(1, TASK, answerer, lambda _task, text: RIGHT if text == "G2" else WRONG, turns=5)
    assert [each.passed for each in found.verdicts] == [False, True]
    assert (found.answers, found.answer_s) == (("G1", "G2"), 2.0)
    assert "is not reached" not in prompts[0]
    assert "Your answer:\nG1" in prompts[1]
    assert "- path: is not reached" in prompts[1]
    assert found.prompt_tokens == sum(map(tokens_in, prompts))


def test_an_answer_that_is_missing_is_a_turn() -> None:
    found = attempt(1, TASK, lambda *_: Answer(missing="it took too long"), lambda *_: RIGHT, turns=2)
    assert [each.findings[0].message for each in found.verdicts] == ["it took too long"] * 2


def test_pass_at_k_is_estimated_from_all_attempts() -> None:
    one_of_four = tried((RIGHT,), (WRONG,), (WRONG,), (WRONG, RIGHT))
    none = tried((WRONG,), (WRONG,), (WRONG,), (WRONG,))
    assert pass_at([one_of_four], 1) == pytest.approx(0.25)
    assert pass_at([one_of_four], 2) == pytest.approx(0.5)
    assert pass_at([one_of_four, none], 4) == pytest.approx(0.5)
    assert pass_at([], 1) == 0.0
    assert [passed_within([one_of_four], turns) for turns in (1, 2)] == [0.25, 0.5]


@pytest.mark.parametrize(
    ("text", "count"), [("", 0), ("G01 X12.5", 6), ("G1010 (go on)", 7), ("ok: 12345", 4)]
)
def test_tokens_are_words_groups_of_three_digits_and_signs(text: str, count: int) -> None:
    assert tokens_in(text) == count


def test_a_command_is_asked_again_with_what_was_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = (
        "import sys; text = sys.stdin.read(); "
        "print('G1010\\nG94 F6000\\nG01 X30 Y' + ('40' if 'simulated and fails' in text else '41'))"
    )
    command = shlex.join([sys.executable, "-c", script])
    arguments = ["--command", command, "--only", "line-at-a-speed", "--samples", "2", "--turns", "3"]
    assert run([*arguments, "--save", str(tmp_path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["pass_at"] == {"1": 0.0, "2": 0.0}
    assert answer["passed_within_turns"] == [0.0, 1.0, 1.0]
    assert answer["results"][0]["attempts"] == [[False, True], [False, True]]
    assert answer["tokens"]["answer"] == 4 * tokens_in("G1010\nG94 F6000\nG01 X30 Y40")
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "line-at-a-speed.gcode",
        "line-at-a-speed.sample-1.turn-2.gcode",
        "line-at-a-speed.sample-2.turn-1.gcode",
        "line-at-a-speed.sample-2.turn-2.gcode",
    ]
