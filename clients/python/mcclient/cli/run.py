"""``mcctl run FILE``."""

from __future__ import annotations

import asyncio
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from mcclient.cli.ahead import JobOptions
from mcclient.cli.certified import run_certified
from mcclient.cli.go_on import OutputsOption, WayOption
from mcclient.cli.job import Job
from mcclient.cli.options import (
    AxesOption,
    JsonOption,
    Target,
    parse_axes,
)
from mcclient.cli.output import errors_shown, narration
from mcclient.cli.source import ProgramSource
from mcclient.errors import ConfigurationError, RequestRefused


class OnDisconnectChoice(StrEnum):
    """What happens to the program when this command's link goes."""

    STOP = "stop"
    FINISH = "finish"


def run(
    target: Target,
    file: Annotated[str, typer.Argument(metavar="FILE", help="The G-code program; - reads standard input.")],
    axes: AxesOption = None,
    from_line: Annotated[
        int,
        typer.Option(
            "--from-line", metavar="N", min=1, help="Begin at this line, where those before it end."
        ),
    ] = 1,
    record: Annotated[
        Path | None,
        typer.Option("--record", metavar="OUT.npz", help="Keep the path really taken, cycle by cycle."),
    ] = None,
    step: Annotated[bool, typer.Option("--step", help="Line by line: Enter starts the next one.")] = False,
    block_delete: Annotated[
        bool, typer.Option("--block-delete", help="Skip lines that begin with /.")
    ] = False,
    optional_stop: Annotated[
        bool, typer.Option("--optional-stop/--no-optional-stop", help="Whether M01 is a pause.")
    ] = True,
    check: Annotated[
        bool, typer.Option("--check/--no-check", help="Look for faults in the whole text first.")
    ] = True,
    on_disconnect: Annotated[
        OnDisconnectChoice,
        typer.Option("--on-disconnect", help="When this command goes away, stop the program or finish it."),
    ] = OnDisconnectChoice.STOP,
    way: WayOption = False,
    outputs: OutputsOption = None,
    certificate: Annotated[
        Path | None,
        typer.Option(
            "--certificate", metavar="PATH", help="Run this very program as `mcserver certify` approved it."
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Run a program and follow it to its end.

    Ctrl-C asks whether to hold, abort or leave; without a terminal it aborts.
    """
    if certificate is not None:
        plain = (axes, record, outputs) == (None, None, None) and (from_line, step, way) == (1, False, False)
        plain = plain and (block_delete, optional_stop) == (False, True)
        with errors_shown(json):
            if not plain:
                raise RequestRefused(
                    "MC511", "a certificate is of the whole program, as it is", "leave other options out"
                )
        raise typer.Exit(run_certified(target, file, certificate, json))
    with errors_shown(json):
        options = JobOptions(
            target=target,
            axes=parse_axes(axes),
            from_line=from_line,
            record=_checked_output(record),
            step=step,
            check=check,
            on_disconnect="finish" if on_disconnect is OnDisconnectChoice.FINISH else "stop",
            json=json,
            way=way,
            outputs=outputs,
            block_delete=block_delete,
            optional_stop=optional_stop,
            interactive=sys.stdin.isatty() and narration().is_terminal and file != "-",
        )
        if step and file == "-":
            raise RequestRefused("MC511", "--step reads standard input itself", "give the program as a file")
        source = ProgramSource(file)
        try:
            code = asyncio.run(Job(options, source).run())
        finally:
            source.close()
    raise typer.Exit(code)


def _checked_output(path: Path | None) -> Path | None:
    """Raises ConfigurationError (MC537) where no file can be written there, before anything moves."""
    if path is None:
        return None
    if path.suffix != ".npz":
        raise RequestRefused(
            "MC511", f"--record writes NPZ files, {path} is not one", "name it such as out.npz"
        )
    if not path.parent.is_dir():
        raise ConfigurationError("MC537", f"there is no folder {path.parent}", f"mkdir -p {path.parent}")
    return path
