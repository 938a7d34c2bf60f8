"""Attempts at a task: an answer, and further ones after what was found in the one before."""

from __future__ import annotations

import re
from collections.abc import Callable

import msgspec

from mcbenchmark.answers import Answer
from mcbenchmark.prompt import write_prompt, write_repair_prompt
from mcbenchmark.tasks import Task
from mcbenchmark.verdict import Check, Finding, Verdict

# number and name of a task, and what is asked
Answerer = Callable[[int, Task, str], Answer]
Judge = Callable[[Task, str], Verdict]

# A word, up to three digits, or one sign: near what the tokenizers of models count, and the same for all.
_TOKEN = re.compile(r"[^\W\d_]+|\d{1,3}|[^\w\s]|_")


class Attempt(msgspec.Struct, frozen=True):
    """One attempt.

    Attributes:
        verdicts: one a turn; the last one passes, or there are no more turns.
        answers: as they came. answer_s: that they took. prompt_tokens, answer_tokens: of all turns.
    """

    verdicts: tuple[Verdict, ...]
    answers: tuple[str, ...]
    answer_s: float
    prompt_tokens: int
    answer_tokens: int

    def passed_within(self, turns: int) -> bool:
        """Return True if one of the first turns passed."""
        return any(each.passed for each in self.verdicts[:turns])


def tokens_in(text: str) -> int:
    """Count the words, groups of up to three digits, and signs of a text."""
    return len(_TOKEN.findall(text))


def attempt(number: int, task: Task, answerer: Answerer, judge: Judge, turns: int = 1) -> Attempt:
    """Ask, judge, and ask again with what was found, until an answer passes or the turns are over."""
    verdicts: list[Verdict] = []
    answers: list[str] = []
    took, asked, answered = 0.0, 0, 0
    prompt = write_prompt(task)
    for _ in range(turns):
        answer = answerer(number, task, prompt)
        took += answer.duration_s
        asked += tokens_in(prompt)
        answered += tokens_in(answer.text)
        answers.append(answer.text)
        if answer.missing:
            verdict = Verdict(task.id, task.category, (Finding(Check.ANSWER, answer.missing),))
        else:
            verdict = judge(task, answer.text)
        verdicts.append(verdict)
        if verdict.passed:
            break
        prompt = write_repair_prompt(task, answer.text, verdict)
    return Attempt(tuple(verdicts), tuple(answers), took, asked, answered)
