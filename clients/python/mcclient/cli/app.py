"""The command tree of ``mcctl``, and what its exit codes mean.

0 ok, 1 the job failed while running, 2 usage, 3 configuration, 4 program rejected, 5 nobody answers.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from types import MappingProxyType
from typing import Annotated, Any

import typer

from mcclient.cli.options import with_target
from mcclient.cli.output import exit_code_of, say, show_error
from mcclient.cli.terminal import run_app
from mcclient.cli.visible import LogFormatter
from mcclient.errors import MotionError

INTERRUPTED = 130
FAILED = 1


def _show_version(wanted: bool) -> None:
    if wanted:
        try:
            shown = version("mcclient")
        except PackageNotFoundError:
            shown = "(not installed: run from its sources)"
        typer.echo(f"mcctl {shown}")
        raise typer.Exit


# Module and function of each command, and what builds each group of commands, in the order of the help.
COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "list": "look.list_",
        "status": "look.status",
        "programs": "look.programs",
        "watch": "watch.watch",
        "run": "run.run",
        "continue": "go_on.continue_",
        "send": "send.send",
        "zero": "zero.zero",
        "tables": "work_tables.tables",
        "console": "console.console",
        "hold": "operate.hold",
        "resume": "operate.resume",
        "abort": "operate.abort",
        "override": "operate.override",
        "jog": "operate.jog",
        "home": "home.home",
        "reference": "home.reference",
        "mesh": "mesh.mesh",
        "reset": "operate.reset",
        "estop": "operate.estop",
        "arm": "arm.arm",
        "history": "history.history",
    }
)
GROUPS: Mapping[str, str] = MappingProxyType(
    {
        "record": "record.build_app",
        "io": "io.build_app",
        "drives": "drives.build_drives_app",
        "sdo": "drives.build_sdo_app",
        "fleet": "fleet.build_app",
    }
)
NEGATIVE = ("jog", "reference")


def _imported(place: str) -> Callable[..., Any]:
    module, _, function = place.partition(".")
    found: Callable[..., Any] = getattr(import_module(f"mcclient.cli.{module}"), function)
    return found


def build_app(only: str | None = None) -> typer.Typer:
    """Build the command tree.

    Args:
        only: the command that is called, so that no other's modules are imported; None: all, as help and
            completion need them.
    """
    app = typer.Typer(
        name="mcctl",
        help="Operate machines of the open motion server.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        # rich's own markup would take "[mm, deg]" for a style and leave it out
        rich_markup_mode="markdown",
        context_settings={"help_option_names": ["-h", "--help"]},
    )

    @app.callback()
    def root(
        version: Annotated[
            bool, typer.Option("--version", help="Say the version.", callback=_show_version, is_eager=True)
        ] = False,
    ) -> None:
        """Operate machines of the open motion server."""

    for name, place in COMMANDS.items():
        if only in (None, name):
            # a distance, a velocity or a position may be negative: such words are no options
            settings = {"ignore_unknown_options": True} if name in NEGATIVE else None
            app.command(name, context_settings=settings)(with_target(_imported(place)))
    for name, place in GROUPS.items():
        if only in (None, name):
            app.add_typer(_imported(place)(), name=name)
    return app


def run_command_line(arguments: list[str] | None = None) -> int:
    """Runs one command line and gives its exit code; every error is shown once, none with a traceback."""
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(LogFormatter())
    words = sys.argv[1:] if arguments is None else arguments
    called = words[0] if words and (words[0] in COMMANDS or words[0] in GROUPS) else None
    try:
        return _flushed(run_app(build_app(called), arguments, "mcctl"))
    except SystemExit as done:
        return _flushed(done.code if isinstance(done.code, int) else int(done.code is not None))
    except MotionError as error:
        show_error(error)
        return exit_code_of(error)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        _abandon_standard_output()
        return FAILED
    except OSError as error:
        say(f"error[MC015]: the operating system refused: {error}", "bold red")
        return FAILED


def _flushed(code: int) -> int:
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        _abandon_standard_output()
        return FAILED
    return code


def _abandon_standard_output() -> None:
    """Lets the interpreter's last flush of a broken standard output go nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, sys.stdout.fileno())
    finally:
        os.close(nowhere)
