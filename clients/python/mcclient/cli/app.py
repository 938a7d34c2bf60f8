"""The command tree of ``mcctl``, and what its exit codes mean.

0 ok, 1 the job failed while running, 2 usage, 3 configuration, 4 program rejected, 5 nobody answers.
"""

from __future__ import annotations

import os
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated

import typer

from mcclient.cli import (
    arm,
    console,
    drives,
    fleet,
    history,
    home,
    io,
    look,
    operate,
    record,
    run,
    send,
    watch,
    zero,
)
from mcclient.cli.output import exit_code_of, say, show_error
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


def build_app() -> typer.Typer:
    """The command tree."""
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

    app.command("list")(look.list_)
    app.command("status")(look.status)
    app.command("programs")(look.programs)
    app.command("watch")(watch.watch)
    app.command("run")(run.run)
    app.command("send")(send.send)
    app.command("zero")(zero.zero)
    app.command("console")(console.console)
    app.command("hold")(operate.hold)
    app.command("resume")(operate.resume)
    app.command("step")(operate.step)
    app.command("abort")(operate.abort)
    app.command("override")(operate.override)
    # a distance or a velocity may be negative: such words are no options
    app.command("jog", context_settings={"ignore_unknown_options": True})(operate.jog)
    app.command("home")(home.home)
    app.command("reference", context_settings={"ignore_unknown_options": True})(home.reference)
    app.command("reset")(operate.reset)
    app.command("estop")(operate.estop)
    app.command("arm")(arm.arm)
    app.command("history")(history.history)
    app.add_typer(record.build_app(), name="record")
    app.add_typer(io.build_app(), name="io")
    app.add_typer(drives.build_drives_app(), name="drives")
    app.add_typer(drives.build_sdo_app(), name="sdo")
    app.add_typer(fleet.build_app(), name="fleet")
    return app


def run_command_line(arguments: list[str] | None = None) -> int:
    """Runs one command line and gives its exit code; every error is shown once, none with a traceback."""
    try:
        build_app()(args=arguments, prog_name="mcctl")
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
    return 0


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
