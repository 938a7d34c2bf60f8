"""``mcctl send 'G01 X10'``: a few lines as a program of their own."""

from __future__ import annotations

import os
from typing import Annotated, Any

import typer

from mcclient.broken_off import SENT
from mcclient.cli.options import (
    AxesOption,
    JsonOption,
    Target,
    parse_axes,
)
from mcclient.cli.output import carry_out, error_as_json, exit_code_of, results, write_json
from mcclient.cli.terminal import show_diagnostics
from mcclient.errors import ProgramRejected, RequestRefused


def send(
    target: Target,
    lines: Annotated[list[str], typer.Argument(metavar="LINE...", help="Lines of G-code, each in quotes.")],
    axes: AxesOption = None,
    at_pause: Annotated[
        bool,
        typer.Option(
            "--at-pause", help="Run now, also while a program stands at a pause or tool change; never wait."
        ),
    ] = False,
    wait: Annotated[bool, typer.Option("--wait/--no-wait", help="Wait for the motion's end.")] = True,
    json: JsonOption = False,
) -> None:
    """Send lines as one program: mcctl send 'G1010' 'G01 X10 F600'."""
    texts = [text for argument in lines for text in argument.splitlines() or [""]]

    async def work() -> dict[str, Any] | ProgramRejected:
        for argument in lines:
            # a file G28 takes nothing from the line G28
            if os.path.splitext(argument)[1][1:2].isalpha() and os.path.isfile(argument):
                raise RequestRefused("MC511", f"{argument} is a file", f"mcctl run {argument}")
        async with target.open() as one:
            program = await one.program(
                SENT,
                parse_axes(axes),
                on_disconnect="stop" if wait else "finish",
                at_pause=at_pause,
            )
            try:
                for text in texts:
                    await program.send(text)
                if wait:
                    await program.finish()
                else:
                    await program.close()
            except ProgramRejected as error:
                # what is before the rejected line runs to its end, as it does in a file
                if not program.ended:
                    await program.finish()
                return error
            return {"program": program.id, "state": program.state, "done": program.done_through}

    outcome = carry_out(work, json)
    if isinstance(outcome, ProgramRejected):
        show_diagnostics(
            outcome.diagnostics, lambda line: texts[line - 1] if 0 < line <= len(texts) else None, "send"
        )
        if json:
            write_json(error_as_json(outcome))
        raise typer.Exit(exit_code_of(outcome)) from outcome
    if json:
        write_json({"ok": True, **outcome})
    else:
        results().print(f"{outcome['program']}: {outcome['state']}, {outcome['done']} lines done")
