"""``mcctl continue``: goes on with a program that was broken off, once the way is shown."""

from __future__ import annotations

import asyncio
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from mcclient.broken_off import broken_off
from mcclient.cli.options import JsonOption, Target, axis_name
from mcclient.cli.output import narration, results, say, write_json
from mcclient.cli.source import ProgramSource
from mcclient.errors import RequestRefused
from mcclient.machine import Machine
from mcclient.switches import switches_said
from mcclient.types import ENDED, Continuation, Need, Outputs

SHOWN = 20


class OutputsChoice(StrEnum):
    """What happens to what the program had switched."""

    SET = "set"
    LEAVE = "leave"


WayOption = Annotated[
    bool, typer.Option("--way", help="Take the way that is shown, where the machine file names no safe one.")
]
OutputsOption = Annotated[
    OutputsChoice | None,
    typer.Option("--outputs", help="Set what the program had switched (spindle, coolant), or leave it."),
]


def outputs_of(choice: OutputsChoice | None) -> Outputs | None:
    """Return a choice as the wire has it."""
    return None if choice is None else Outputs(choice.value)


def continue_(
    target: Target,
    program: Annotated[
        str | None, typer.Argument(metavar="[PROGRAM]", help="Its id; without it the newest broken off.")
    ] = None,
    line: Annotated[
        int | None,
        typer.Option("--line", min=1, help="The first that runs; else that behind the last done."),
    ] = None,
    way: WayOption = False,
    outputs: OutputsOption = None,
    file: Annotated[
        Path | None, typer.Option("--file", help="The whole program, where the server has not all of it.")
    ] = None,
    show: Annotated[bool, typer.Option("--show", help="Show what would be done; nothing moves.")] = False,
    json: JsonOption = False,
) -> None:
    """Go on with a program after a crash, a fault or an abort: mcctl continue. Ctrl-C aborts it."""

    async def work(machine: Machine) -> tuple[str, dict[str, Any]]:
        name = program or await _newest(machine)
        shown = await machine.continuation(name, line=line)
        _tell(shown, needs=show)
        if show:
            return machine.name, {"continuation": shown}
        rest = _rest(shown, file)
        agreed_way, agreed_outputs = await _agree(shown, way, outputs)
        async with machine.continue_program(
            name, line=line, way=agreed_way, outputs=outputs_of(agreed_outputs)
        ) as opened:
            if not shown.whole:
                await opened.send_lines(rest)
        return machine.name, {"program": opened.id, "state": opened.state, "done": opened.done_through}

    name, outcome = target.carry_out(work, json)
    if json:
        plain = {key: value for key, value in outcome.items() if key != "continuation"}
        shown = outcome.get("continuation")
        write_json({"ok": True, "machine": name, **plain, **({} if shown is None else _as_json(shown))})
    elif "program" in outcome:
        results().print(f"{name}: {outcome['state']}, lines through {outcome['done']} are done")


def _as_json(shown: Continuation) -> dict[str, Any]:
    return {
        "program": shown.program,
        "line": shown.line,
        "done": shown.done,
        "way": [step.text for step in shown.way],
        "axes": [{"axis": each.axis, "now": each.now, "there": each.there} for each in shown.axes],
        "needs": [
            {"code": each.code, "message": each.message, "confirm": each.confirm} for each in shown.needs
        ],
    }


async def _newest(machine: Machine) -> str:
    programs = await machine.programs(limit=SHOWN)
    if any(each.state not in ENDED for each in programs):
        raise RequestRefused("MC517", "a program is open", "wait for its end, or name the one to go on with")
    found = broken_off(programs)
    if found is None:
        raise RequestRefused("MC503", "no program was broken off", "mcctl programs lists them")
    return found.program


def _tell(shown: Continuation, *, needs: bool) -> None:
    """Say what is certain, and the way; ``needs``: say also what has to be done or answered first."""
    say(f"{shown.name or shown.program}: lines through {shown.done} are certain, on at line {shown.line}")
    for number, text in enumerate(shown.lines, shown.first):
        say(f"{'>' if number == shown.line else ' '}{number:>6} | {text}")
    for switched in switches_said(shown.block_delete, shown.optional_stop):
        say(f"  {switched}")
    for need in shown.needs if needs else ():
        say(f"{need.code}: {need.message}; {need.hint}", "yellow")
    if any(need.code == "MC450" for need in shown.needs):
        # where the axes stand, and so the way, is known once they are homed
        return
    for axis in shown.axes:
        if axis.away:
            there = "not known" if axis.there is None else f"{axis.there:.3f} {axis.unit}"
            say(f"{axis_name(axis.axis)} is at {axis.now:.3f} {axis.unit}, the program has it at {there}")
    for step in shown.way:
        say(f"  - {step.text}")


def _rest(shown: Continuation, file: Path | None) -> list[str]:
    """Return the lines behind those that the server has.

    Raises:
        RequestRefused: MC511 they are not known, or the file is another program.
    """
    if shown.whole:
        return []
    if file is None:
        raise RequestRefused(
            "MC511", f"only lines through {shown.accepted} are known", "give the whole program with --file"
        )
    lines = list(ProgramSource(str(file)).lines())
    if lines[shown.first - 1 : shown.first - 1 + len(shown.lines)] != list(shown.lines):
        raise RequestRefused("MC511", f"{file} is not the program that was broken off", "give that one")
    return lines[shown.accepted :]


async def _agree(
    shown: Continuation, way: bool, outputs: OutputsChoice | None
) -> tuple[bool, OutputsChoice | None]:
    """Ask for what has to be confirmed, where somebody can be asked.

    Raises:
        RequestRefused: the code of what was not.
    """
    for need in shown.needs:
        if need.confirm == "way" and not way:
            way = await _ask(need, "Take this way?", "--way")
        elif need.confirm == "outputs" and outputs is None:
            asked = await _ask(need, "Set them? (else nothing is done)", "--outputs set, or --outputs leave")
            outputs = OutputsChoice.SET if asked else None
        elif not need.confirm:
            raise RequestRefused(need.code, need.message, need.hint)
    return way, outputs


async def _ask(need: Need, question: str, option: str) -> bool:
    if not (sys.stdin.isatty() and narration().is_terminal):
        raise RequestRefused(need.code, need.message, f"{need.hint}; here: {option}")
    say(need.message, "yellow")
    if not await asyncio.to_thread(typer.confirm, question, err=True):
        raise RequestRefused(need.code, need.message, need.hint)
    return True
