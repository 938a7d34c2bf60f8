"""Generated tasks can be solved, are the same of one seed, and say nothing of a private one."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest
from mcbenchmark.cli import run
from mcbenchmark.families import FAMILIES
from mcbenchmark.generated import MIN_SEED, generated_tasks, read_seed, split_of
from mcbenchmark.judge import judge
from mcbenchmark.tasks import Task, TaskFile, mistake

from mcserver.errors import ConfigurationError


@pytest.mark.parametrize("task", generated_tasks(len(FAMILIES), "tests"), ids=lambda task: task.category)
def test_every_family_can_be_solved(task: Task) -> None:
    assert mistake(task) == ""
    assert judge(task, task.solution).findings == ()
    assert msgspec.convert({"task": [msgspec.to_builtins(task)]}, TaskFile).task == (task,)


def test_some_hundred_tasks_of_profiles_cnc_and_robot_too() -> None:
    tasks = generated_tasks(300)
    assert len({task.id for task in tasks}) == 300
    assert len({task.prompt for task in tasks}) >= 290
    assert {Path(task.machine).stem for task in tasks} == {
        "cartesian",
        "arm6",
        "robot-dog",
        "mill",
        "handling",
    }


def test_one_seed_makes_the_same_tasks_and_another_one_others() -> None:
    assert generated_tasks(40, "a") == generated_tasks(40, "a")[:40]
    assert generated_tasks(20, "a") == generated_tasks(40, "a")[:20]
    assert not set(map(str, generated_tasks(40, "a"))) & set(map(str, generated_tasks(40, "b")))


def test_a_private_seed_is_read_from_a_file_and_not_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "seed"
    file.write_text("a-seed-that-nobody-knows\n")
    assert read_seed(file) == "a-seed-that-nobody-knows"
    arguments = ["--generated", "4", "--seed-file", str(file), "--baseline", "solution", "--json"]
    assert run(arguments) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["split"] == f"generated-4-{split_of('a-seed-that-nobody-knows')}"
    assert "nobody" not in json.dumps(answer)
    assert answer["score"] == 1.0


@pytest.mark.parametrize("content", [b"", b"x" * (MIN_SEED - 1), b"\xff" * 40])
def test_a_seed_that_can_be_guessed_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "seed").write_bytes(content)
    for file in (tmp_path / "seed", tmp_path / "absent"):
        with pytest.raises(ConfigurationError, match="MC080"):
            read_seed(file)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--generated", "3", "--tasks", ".", "--baseline", "solution"],
        ["--seed-file", "seed", "--baseline", "solution"],
        ["--samples", "3", "--baseline", "solution"],
        ["--turns", "2", "."],
        ["--mutants", "3", "--baseline", "solution"],
    ],
)
def test_options_that_do_not_fit_together_are_refused(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*arguments, "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["ok"] is False
