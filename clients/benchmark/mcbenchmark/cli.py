"""``mcbenchmark``: tasks in words for writers of programs, judged by simulation."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, BinaryIO

import typer
from rich.table import Table
from rich.text import Text

from mcbenchmark.answers import Answer, AnsweringCommand, read_answer
from mcbenchmark.baselines import Baseline, answer_by
from mcbenchmark.judge_process import JudgeProcess
from mcbenchmark.prompt import write_prompt
from mcbenchmark.scores import as_json, by_category, score
from mcbenchmark.tasks import Task, load_tasks, shipped_tasks
from mcbenchmark.verdict import Check, Finding, Verdict
from mcserver.cli.app import run_command_line
from mcserver.cli.console import json_answer_on_error, narration, results, write_json
from mcserver.cli.options import JsonOption
from mcserver.cli.output_file import write_atomically
from mcserver.errors import UsageFault

Numbered = Sequence[tuple[int, Task]]
Answerer = Callable[[int, Task], Answer]


def benchmark(
    answers: Annotated[
        Path | None, typer.Argument(metavar="[ANSWERS]", help="A folder of NNN.gcode or TASK.gcode.")
    ] = None,
    command: Annotated[
        str | None,
        typer.Option("--command", metavar="C", help="Reads a prompt, writes a program; once for each task."),
    ] = None,
    baseline: Annotated[
        Baseline | None, typer.Option("--baseline", help="Judge answers that need no model.")
    ] = None,
    prompts: Annotated[
        Path | None, typer.Option("--prompts", metavar="DIR", help="Write the prompts there, and end.")
    ] = None,
    tasks: Annotated[
        Path | None, typer.Option("--tasks", metavar="DIR", help="Tasks of your own, as TOML files.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="NAME", help="These categories or tasks alone. Repeatable."),
    ] = None,
    save: Annotated[
        Path | None, typer.Option("--save", metavar="DIR", help="Keep the answers there, as TASK.gcode.")
    ] = None,
    timeout: Annotated[
        float, typer.Option("--timeout", min=0.1, max=86400.0, help="For each run of the command [s].")
    ] = 120.0,
    seed: Annotated[int, typer.Option("--seed", help="Of the random baseline.")] = 1,
    json: JsonOption = False,
) -> None:
    """Score a writer of programs on tasks in words, judged by simulation."""
    with json_answer_on_error(json, {"ok": False}):
        if sum(each is not None for each in (answers, command, baseline, prompts)) != 1:
            raise UsageFault(
                "MC017",
                "one source of answers is needed",
                "a folder, --command, --baseline, or --prompts to write the prompts",
            )
        chosen = _choose(shipped_tasks() if tasks is None else load_tasks(tasks), only or [])
        if prompts is not None:
            for number, task in chosen:
                _write(prompts, f"{number:03d}-{task.id}.txt", write_prompt(task))
        else:
            answerer = _answerer(answers, command, baseline, timeout, seed)
            verdicts, durations = _judge_all(chosen, answerer, save)
    if prompts is not None:
        narration().print(f"{len(chosen)} prompts: {prompts}")
        if json:
            write_json({"ok": True, "prompts": len(chosen), "folder": str(prompts)})
    elif json:
        write_json(as_json(verdicts, durations))
    else:
        _show(verdicts)


def run(arguments: list[str] | None = None) -> int:
    """Run one command line and give its exit code, as those of ``mcserver``."""
    app = typer.Typer(name="mcbenchmark", pretty_exceptions_enable=False, rich_markup_mode="markdown")
    app.command(context_settings={"help_option_names": ["-h", "--help"]})(benchmark)
    return run_command_line(arguments, app)


def main() -> None:
    """Entry point; leaves the process with the documented exit code."""
    sys.exit(run())


def _choose(tasks: Sequence[Task], only: Sequence[str]) -> Numbered:
    numbered = list(enumerate(tasks, 1))
    if not only:
        return numbered
    known = {name for task in tasks for name in (task.id, task.category)}
    unknown = [name for name in only if name not in known]
    if unknown:
        categories = ", ".join(dict.fromkeys(task.category for task in tasks))
        raise UsageFault("MC017", f"there is no task or category {unknown[0]!r}", f"categories: {categories}")
    return [(number, task) for number, task in numbered if task.id in only or task.category in only]


def _answerer(
    folder: Path | None, command: str | None, baseline: Baseline | None, timeout: float, seed: int
) -> Answerer:
    if folder is not None:
        if not folder.is_dir():
            raise UsageFault("MC010", f"{folder} is not a folder", "name a folder of NNN.gcode")
        return lambda number, task: read_answer(folder, number, task.id)
    if command is not None:
        asked = AnsweringCommand(command, timeout)
        return lambda _, task: asked.ask(write_prompt(task))
    assert baseline is not None
    return lambda _, task: Answer(answer_by(baseline, task, seed))


def _judge_all(chosen: Numbered, answerer: Answerer, save: Path | None) -> tuple[list[Verdict], list[float]]:
    verdicts: list[Verdict] = []
    durations: list[float] = []
    console = narration()
    with JudgeProcess() as judge:
        for number, task in chosen:
            answer = answerer(number, task)
            if save is not None and not answer.missing:
                _write(save, f"{task.id}.gcode", answer.text)
            verdict = (
                Verdict(task.id, task.category, (Finding(Check.ANSWER, answer.missing),))
                if answer.missing
                else judge.judge(task, answer.text)
            )
            verdicts.append(verdict)
            durations.append(answer.duration_s)
            if console.is_terminal:
                console.print(f"{number:3d} {task.id}: {'passed' if verdict.passed else 'failed'}")
    return verdicts, durations


def _show(verdicts: Sequence[Verdict]) -> None:
    console = results()
    failed = [each for each in verdicts if not each.passed]
    if failed:
        reasons = Table("task", "check", "reason", box=None, pad_edge=False)
        for verdict in failed:
            for place, finding in enumerate(verdict.findings):
                name = "" if place else verdict.task
                reasons.add_row(name, finding.check.value, Text(finding.message))
        console.print(reasons)
        console.print()
    scores = Table("category", box=None, pad_edge=False)
    scores.add_column("passed", justify="right")
    scores.add_column("tasks", justify="right")
    for name, each in by_category(verdicts).items():
        scores.add_row(Text(name), str(each.passed), str(each.tasks))
    whole = score(verdicts)
    scores.add_row("all", str(whole.passed), str(whole.tasks), style="bold")
    console.print(scores)


def _write(folder: Path, name: str, text: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(str(folder / name), functools.partial(_put, text.encode("utf-8", "replace")))


def _put(content: bytes, stream: BinaryIO) -> None:
    stream.write(content)
