"""A trial of the judge: wrong answers that it has to catch, right ones that it has to let pass."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

import msgspec

from mcbenchmark.judge import judge, same_motion
from mcbenchmark.mutations import mutants
from mcbenchmark.tasks import Task


class Missed(msgspec.Struct, frozen=True):
    """A wrong answer that passed."""

    task: str
    kind: str
    text: str


class Trial(msgspec.Struct, frozen=True):
    """What a judge is worth on some tasks.

    Attributes:
        wrong: answers that were judged; those that move as the solution does are not among them.
        missed: of them those that passed. refused: tasks whose own solution fails.
    """

    wrong: int
    missed: tuple[Missed, ...]
    refused: tuple[str, ...]

    @property
    def caught(self) -> float:
        """Share of the wrong answers that fail."""
        return 1.0 - len(self.missed) / self.wrong if self.wrong else 1.0


def try_judge(tasks: Sequence[Task], count: int, seed: int) -> Trial:
    """Judge so many wrong answers, made of the solutions of tasks by chance, and every solution."""
    random = Random(f"mutants {seed}")
    wrong, missed, lasting = 0, [], 0
    while wrong < count and lasting < 10 * count:
        lasting += 1
        task = random.choice(tasks)
        mutant = next(mutants(task, random), None)
        if mutant is None:
            continue
        if judge(task, mutant.text).passed:
            if same_motion(task, task.solution, mutant.text):
                continue
            missed.append(Missed(task.id, mutant.kind, mutant.text))
        wrong += 1
    refused = tuple(task.id for task in tasks if not judge(task, task.solution).passed)
    return Trial(wrong, tuple(missed), refused)
