"""Answers that need no model: what a score is worth is seen beside theirs."""

from __future__ import annotations

import enum
import re
from collections.abc import Sequence
from random import Random

from mcbenchmark.tasks import Task
from mcserver.language.grammar.derive import derive
from mcserver.language.grammar.dialect import build_grammar
from mcserver.machine.machine_file import load_machine

_LINES = 6  # of a random program
_NUMBER = r"-?\d+(?:\.\d+)?"
_PLACE = re.compile(rf"(?:\b[XYZABC]{_NUMBER}\b[ ,]*)+")
_SPEED = re.compile(rf"({_NUMBER}) mm/s")
_TIME = re.compile(rf"in (?:exactly )?({_NUMBER}) s\b")
_TOOL = re.compile(r"\(tool (\d+)")


class Baseline(enum.StrEnum):
    """A generator of answers."""

    SOLUTION = "solution"  # the task's own: the judge's upper end
    TEMPLATE = "template"  # the places of the prompt, joined by straight lines
    RANDOM = "random"  # lines from the machine's grammar


def answer_by(baseline: Baseline, task: Task, seed: int) -> str:
    """Write an answer; ``seed`` and the task's name decide what a random one is."""
    match baseline:
        case Baseline.SOLUTION:
            return task.solution
        case Baseline.TEMPLATE:
            return _from_template(task.prompt)
        case Baseline.RANDOM:
            random = Random(f"{seed} {task.id}")
            grammar = build_grammar(load_machine(task.machine))
            return "\n".join(["G1010", *(derive(grammar, random, "line") for _ in range(_LINES)), ""])


def _from_template(prompt: str) -> str:
    """Capture, take a speed from the words, and go through every place that they name."""
    words = " ".join(prompt.split())
    time, speed, tool = _TIME.search(words), _SPEED.search(words), _TOOL.search(words)
    if time is not None:
        feed = f"G93 F{60 / float(time[1]):.6g}"
    else:
        feed = f"G94 F{60 * float(speed[1]) if speed is not None else 6000:.6g}"
    lines = ["G1010", feed, f"G01 T{tool[1]}" if tool is not None else "G01"]
    places: Sequence[str] = _PLACE.findall(words)
    return "\n".join([*lines, *(place.replace(",", " ").strip() for place in places), ""])
