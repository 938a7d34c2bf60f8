"""Scores of a run of the benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from mcbenchmark.verdict import Verdict


class Score(msgspec.Struct, frozen=True):
    """Tasks passed, of how many."""

    passed: int
    tasks: int

    @property
    def share(self) -> float:
        return self.passed / self.tasks if self.tasks else 0.0


def score(verdicts: Sequence[Verdict]) -> Score:
    """Count the verdicts that pass."""
    return Score(sum(each.passed for each in verdicts), len(verdicts))


def by_category(verdicts: Sequence[Verdict]) -> dict[str, Score]:
    """Score each category, in the order of the tasks."""
    categories = dict.fromkeys(each.category for each in verdicts)
    return {name: score([each for each in verdicts if each.category == name]) for name in categories}


def as_json(verdicts: Sequence[Verdict], durations_s: Sequence[float]) -> dict[str, Any]:
    """Make the object of ``--json``; ``durations_s`` are the times that the answers took."""
    whole = score(verdicts)
    return {
        "ok": True,
        "passed": whole.passed,
        "tasks": whole.tasks,
        "score": whole.share,
        "categories": {
            name: {"passed": each.passed, "tasks": each.tasks, "score": each.share}
            for name, each in by_category(verdicts).items()
        },
        "results": [
            {
                "task": each.task,
                "category": each.category,
                "passed": each.passed,
                "answer_s": duration,
                "findings": [msgspec.to_builtins(finding) for finding in each.findings],
            }
            for each, duration in zip(verdicts, durations_s, strict=True)
        ],
    }
