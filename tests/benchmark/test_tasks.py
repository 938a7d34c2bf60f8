"""Every task that is shipped can be solved, and the judge refuses each spoiled form of its solution."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcbenchmark.judge import judge
from mcbenchmark.prompt import write_prompt
from mcbenchmark.tasks import Task, load_tasks, shipped_tasks, spoiled

from mcserver.errors import ConfigurationError

TASKS = shipped_tasks()


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.id)
def test_the_solution_passes_and_every_spoiled_form_of_it_fails(task: Task) -> None:
    assert judge(task, task.solution).findings == ()
    for text in spoiled(task):
        assert not judge(task, text).passed, text


def test_sixty_tasks_in_thirteen_categories_are_for_three_machines() -> None:
    assert len(TASKS) == 60
    assert len({task.category for task in TASKS}) == 13
    assert {task.machine for task in TASKS} == {"cartesian", "robot-dog", "arm6"}


def test_a_program_that_only_energizes_passes_no_task() -> None:
    assert not any(judge(task, "G1010\n").passed for task in TASKS[::6])


@pytest.mark.parametrize("task", TASKS[::12], ids=lambda task: task.id)
def test_the_prompt_has_the_machine_the_dialect_and_the_words_and_no_solution(task: Task) -> None:
    prompt = write_prompt(task)
    assert task.prompt.strip() in prompt
    assert f'"machine":"{task.machine}"' in prompt
    assert "G1010" in prompt
    assert task.solution.strip() not in prompt


RIGHT = """
[[task]]
id = "one"
category = "mine"
machine = "cartesian"
prompt = "Move X to 1."
solution = "G1010\\nF600\\nG01 X1"
spoil = [["X1", "X2"]]
[task.expect]
path = [{ to = { X = 1 }, by = "line" }]
"""


def test_tasks_of_ones_own_are_read_with_machines_beside_them(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(RIGHT.replace('"cartesian"', '"cell.toml"'))
    (task,) = load_tasks(tmp_path)
    assert task.machine == str(tmp_path / "cell.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('id = "one"', 'id = "../one"', "an id has"),
        ("X = 1 }", "Q = 1 }", "'Q' is no coordinate"),
        ("X = 1 }", 'X = "far" }', "Expected `float`"),
        ('by = "line"', 'by = "spline"', "Invalid enum value"),
        ('by = "line"', 'by = "arc"', "an arc has two coordinates"),
        ('by = "line"', "turn = 90", "only an arc"),
        ('by = "line"', "tolerance = 0", "tolerance above zero"),
        ('by = "line"', "speed = [2, 1]", "empty range"),
        ("to = { X = 1 }", "to = {}", "has a place"),
        ('[["X1", "X2"]]', "[]", "at least one spoiled form"),
        ('[["X1", "X2"]]', '[["X7", "X2"]]', "not in the solution"),
        ("[task.expect]", "[task.expect]\nunheard = 1", "unknown field"),
        ("[task.expect]", "limit_s = 1e9\n[task.expect]", "limit_s"),
        ("[task.expect]", "start = { 'T3.X' = 1 }\n[task.expect]", "start and speeds are of axes"),
        ("[[task]]", "[[task", "Expected"),
        ("[[task]]", RIGHT + "[[task]]", "stands in mine.toml already"),
    ],
)
def test_a_task_that_does_not_fit_the_schema_is_refused_with_its_place(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text(RIGHT.replace(old, new))
    with pytest.raises(ConfigurationError, match=r"MC080.*mine\.toml") as refused:
        load_tasks(tmp_path)
    assert message in refused.value.message


def test_a_folder_without_tasks_is_refused(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "absent"):
        with pytest.raises(ConfigurationError, match="MC080"):
            load_tasks(folder)
