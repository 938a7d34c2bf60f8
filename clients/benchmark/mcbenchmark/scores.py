"""Scores of a run of the benchmark."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import msgspec

from mcbenchmark.attempts import Attempt
from mcbenchmark.verdict import Verdict


class Score(msgspec.Struct, frozen=True):
    """Tasks passed, of how many."""

    passed: int
    tasks: int

    @property
    def share(self) -> float:
        return self.passed / self.tasks if self.tasks else 0.0


class Tried(msgspec.Struct, frozen=True):
    """All attempts at one task, at least one."""

    attempts: tuple[Attempt, ...]

    @property
    def first(self) -> Verdict:
        """The verdict on the first answer of all."""
        return self.attempts[0].verdicts[0]


def score(verdicts: Sequence[Verdict]) -> Score:
    """Count the verdicts that pass."""
    return Score(sum(each.passed for each in verdicts), len(verdicts))


def by_category(verdicts: Sequence[Verdict]) -> dict[str, Score]:
    """Score each category, in the order of the tasks."""
    categories = dict.fromkeys(each.category for each in verdicts)
    return {name: score([each for each in verdicts if each.category == name]) for name in categories}


def pass_at(tried: Sequence[Tried], k: int) -> float:
    """Return the share of tasks that one of k first answers would pass, estimated from all attempts.

    1 - C(n - c, k) / C(n, k) of each task with c of n attempts right (Chen et al. 2021, arXiv:2107.03374).
    """
    if not tried:
        return 0.0
    shares = []
    for each in tried:
        count = len(each.attempts)
        right = sum(one.passed_within(1) for one in each.attempts)
        shares.append(1.0 - math.comb(count - right, k) / math.comb(count, k))
    return sum(shares) / len(shares)


def passed_within(tried: Sequence[Tried], turns: int) -> float:
    """Return the share of attempts that passed within so many turns."""
    attempts = [one for each in tried for one in each.attempts]
    return sum(one.passed_within(turns) for one in attempts) / len(attempts) if attempts else 0.0


def as_json(tried: Sequence[Tried], split: str, samples: int = 1, turns: int = 1) -> dict[str, Any]:
    """Make the object of ``--json``.

    Args:
        split: name of the set of tasks. samples: attempts at each. turns: of an attempt at the most.
    """
    verdicts = [each.first for each in tried]
    whole = score(verdicts)
    attempts = [one for each in tried for one in each.attempts]
    return {
        "ok": True,
        "split": split,
        "passed": whole.passed,
        "tasks": whole.tasks,
        "score": whole.share,
        "pass_at": {str(k): pass_at(tried, k) for k in sorted({1, samples})},
        "passed_within_turns": [passed_within(tried, each) for each in range(1, turns + 1)],
        "tokens": {
            "prompt": sum(each.prompt_tokens for each in attempts),
            "answer": sum(each.answer_tokens for each in attempts),
        },
        "categories": {
            name: {"passed": each.passed, "tasks": each.tasks, "score": each.share}
            for name, each in by_category(verdicts).items()
        },
        "results": [_row(each) for each in tried],
    }


def _row(tried: Tried) -> dict[str, Any]:
    return {
        "task": tried.first.task,
        "category": tried.first.category,
        "passed": tried.first.passed,
        "answer_s": sum(each.answer_s for each in tried.attempts),
        "attempts": [[verdict.passed for verdict in each.verdicts] for each in tried.attempts],
        "findings": [msgspec.to_builtins(finding) for finding in tried.first.findings],
    }
