"""What a writer of programs is given for a task: the machine, the dialect in short, and the words."""

from __future__ import annotations

import functools

import msgspec

from mcbenchmark.tasks import Task
from mcbenchmark.verdict import Verdict
from mcserver.language.agents.knowledge import dialect_topic, machine_facts
from mcserver.machine.machine_file import load_machine

MAX_SHOWN_ANSWER = 16 * 1024  # characters
_RULES = """\
Write a G-code program for this machine. Answer with the program alone, or put it into one block between lines
of ```. Axes are not energized at the start: G1010 does that, or a rapid move. Lengths are mm, angles degrees.
Pass through places exactly and stay on the path that is asked for. A program that is refused or fails is no
answer."""


def write_prompt(task: Task) -> str:
    """Write the whole prompt of a task.

    Raises:
        ConfigurationError: the task's machine cannot be loaded.
    """
    machine, dialect = _knowledge(task.machine)
    parts = [_RULES, "", "Machine:", machine, "", "Dialect:", dialect, "", "Task:", task.prompt.strip()]
    if task.faulty:
        parts += ["", "The program:", "```", task.faulty.strip(), "```"]
    return "\n".join([*parts, ""])


def write_repair_prompt(task: Task, answer: str, verdict: Verdict) -> str:
    """Write what is asked after an answer that failed: the task, the answer, and what was found in it."""
    found = [f"- {each.check.value}: {each.message}" for each in verdict.findings]
    return "\n".join(
        [
            write_prompt(task),
            "Your answer:",
            answer.strip()[:MAX_SHOWN_ANSWER],
            "",
            "It was simulated and fails:",
            *found,
            "",
            "Answer with the whole program, put right.",
            "",
        ]
    )


@functools.lru_cache(maxsize=16)
def _knowledge(source: str) -> tuple[str, str]:
    machine = load_machine(source)
    return msgspec.json.encode(machine_facts(machine)).decode(), dialect_topic("", machine)
