"""``mcbenchmark``: tasks in words for writers of programs, judged by simulation."""

from __future__ import annotations

import functools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, BinaryIO

import msgspec
import typer
from rich.table import Table
from rich.text import Text

from mcbenchmark.answers import Answer, AnsweringCommand, program_in, read_answer
from mcbenchmark.attempts import Answerer, Attempt, attempt
from mcbenchmark.baselines import Baseline, answer_by
from mcbenchmark.generated import PUBLIC_SEED, generated_tasks, read_seed, split_of
from mcbenchmark.judge_process import JudgeProcess
from mcbenchmark.prompt import write_prompt
from mcbenchmark.scores import Tried, as_json, by_category, pass_at, passed_within, score
from mcbenchmark.tasks import Task, load_tasks, shipped_tasks
from mcserver.cli.app import run_command_line
from mcserver.cli.console import json_answer_on_error, narration, results, write_json
from mcserver.cli.options import JsonOption
from mcserver.cli.output_file import write_atomically
from mcserver.errors import UsageFault

Numbered = Sequence[tuple[int, Task]]


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
    seed: Annotated[int, typer.Option("--seed", help="Of the random baseline, and of mutants.")] = 1,
    generated: Annotated[
        int | None,
        typer.Option("--generated", metavar="N", min=1, help="So many tasks with numbers by chance instead."),
    ] = None,
    seed_file: Annotated[
        Path | None,
        typer.Option("--seed-file", metavar="F", help="Private seed of the generated tasks, one line."),
    ] = None,
    samples: Annotated[
        int, typer.Option("--samples", min=1, max=1000, help="Attempts at each task: pass@k.")
    ] = 1,
    turns: Annotated[
        int, typer.Option("--turns", min=1, max=100, help="Answers of an attempt, each told what was found.")
    ] = 1,
    mutants: Annotated[
        int | None,
        typer.Option("--mutants", metavar="N", min=1, help="Try the judge with so many wrong answers."),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Score a writer of programs on tasks in words, judged by simulation."""
    with json_answer_on_error(json, {"ok": False}):
        if sum(each is not None for each in (answers, command, baseline, prompts, mutants)) != 1:
            raise UsageFault(
                "MC017",
                "one source of answers is needed",
                "a folder, --command, --baseline, --mutants, or --prompts to write the prompts",
            )
        if command is None and max(samples, turns) > 1:
            raise UsageFault(
                "MC017", "only a command answers more than once", "give --command with --samples or --turns"
            )
        split, chosen = _tasks(tasks, generated, seed_file, only or [])
        if mutants is not None:
            _show_trial([task for _, task in chosen], mutants, seed, json)
            return
        if prompts is not None:
            for number, task in chosen:
                _write(prompts, f"{number:03d}-{task.id}.txt", write_prompt(task))
        else:
            answerer = _answerer(answers, command, baseline, timeout, seed)
            tried = _judge_all(chosen, answerer, save, samples, turns)
    if prompts is not None:
        narration().print(f"{len(chosen)} prompts: {prompts}")
        if json:
            write_json({"ok": True, "prompts": len(chosen), "folder": str(prompts)})
    elif json:
        write_json(as_json(tried, split, samples, turns))
    else:
        _show(tried, samples, turns)


def run(arguments: list[str] | None = None) -> int:
    """Run one command line and give its exit code, as those of ``mcserver``."""
    app = typer.Typer(name="mcbenchmark", pretty_exceptions_enable=False, rich_markup_mode="markdown")
    app.command(context_settings={"help_option_names": ["-h", "--help"]})(benchmark)
    return run_command_line(arguments, app)


def main() -> None:
    """Entry point; leaves the process with the documented exit code."""
    sys.exit(run())


def _tasks(
    folder: Path | None, generated: int | None, seed_file: Path | None, only: Sequence[str]
) -> tuple[str, Numbered]:
    """Return the name of the set of tasks, and those of it that are chosen."""
    if generated is not None and folder is not None:
        raise UsageFault("MC017", "tasks are either generated or of a folder", "leave one of them out")
    if seed_file is not None and generated is None:
        raise UsageFault("MC017", "a seed is of generated tasks", "give --generated N")
    if generated is None:
        return ("shipped" if folder is None else str(folder)), _choose(
            shipped_tasks() if folder is None else load_tasks(folder), only
        )
    seed = PUBLIC_SEED if seed_file is None else read_seed(seed_file)
    return f"generated-{generated}-{split_of(seed)}", _choose(generated_tasks(generated, seed), only)


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
        return lambda number, task, _: read_answer(folder, number, task.id)
    if command is not None:
        asked = AnsweringCommand(command, timeout)
        return lambda _number, _task, prompt: asked.ask(prompt)
    assert baseline is not None
    return lambda _number, task, _prompt: Answer(answer_by(baseline, task, seed))


def _judge_all(
    chosen: Numbered, answerer: Answerer, save: Path | None, samples: int, turns: int
) -> list[Tried]:
    found: list[Tried] = []
    console = narration()
    with JudgeProcess() as judge:
        for number, task in chosen:
            attempts = [attempt(number, task, answerer, judge.judge, turns) for _ in range(samples)]
            if save is not None:
                _save(save, task, attempts)
            found.append(Tried(tuple(attempts)))
            if console.is_terminal:
                right = sum(each.passed_within(turns) for each in attempts)
                console.print(f"{number:3d} {task.id}: {right} of {samples} passed")
    return found


def _save(folder: Path, task: Task, attempts: Sequence[Attempt]) -> None:
    """Keep the program of each answer: TASK.gcode, and TASK.sample-N.turn-M.gcode of further ones."""
    for sample, each in enumerate(attempts, 1):
        for turn, text in enumerate(each.answers, 1):
            name = task.id if (sample, turn) == (1, 1) else f"{task.id}.sample-{sample}.turn-{turn}"
            if text:
                _write(folder, f"{name}.gcode", program_in(text))


def _show_trial(tasks: Sequence[Task], count: int, seed: int, json: bool) -> None:
    # judging in this process takes the simulation with it
    from mcbenchmark.trial import try_judge

    trial = try_judge(tasks, count, seed)
    if json:
        write_json({"ok": True, "caught": trial.caught, **msgspec.to_builtins(trial)})
        return
    console = results()
    for missed in trial.missed:
        console.print(Text(f"{missed.task}, {missed.kind}, passes though it is wrong:"))
        for line in missed.text.strip().split("\n"):
            console.print(Text(f"  {line}"))
    for name in trial.refused:
        console.print(Text(f"the solution of {name} fails"))
    console.print(f"{100 * trial.caught:.2f} % of {trial.wrong} wrong answers caught")


def _show(tried: Sequence[Tried], samples: int, turns: int) -> None:
    console = results()
    verdicts = [each.first for each in tried]
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
    if samples > 1:
        console.print(
            f"pass@1 {100 * pass_at(tried, 1):.1f} %, pass@{samples} {100 * pass_at(tried, samples):.1f} %"
        )
    for turn in range(2, turns + 1):
        console.print(f"within {turn} turns {100 * passed_within(tried, turn):.1f} %")
    spent = [one for each in tried for one in each.attempts]
    asked, answered = (
        sum(getattr(one, name) for one in spent) for name in ("prompt_tokens", "answer_tokens")
    )
    console.print(f"tokens: {asked} asked, {answered} answered")


def _write(folder: Path, name: str, text: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(str(folder / name), functools.partial(_put, text.encode("utf-8", "replace")))


def _put(content: bytes, stream: BinaryIO) -> None:
    stream.write(content)
