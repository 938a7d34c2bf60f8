"""The server-side command line: ``mcserver run | check | simulate | plot | view | doctor | …``.

Exit codes: 0 ok, 1 failed while running, 2 usage, 3 configuration, 4 program rejected, 5 nobody answers. Bad
input never gives a traceback: each fault has a code and a remedy.
"""

from __future__ import annotations

import errno
import logging
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Annotated, Any

import typer
from mckinematics.errors import KinematicsError

from mcserver.cli.console import narration, show_error
from mcserver.cli.exit_codes import ExitCode, OutOfResources, OutputFault, exit_code_of
from mcserver.cli.terminal_console import run_app
from mcserver.errors import NEEDS_LINUX, ConfigurationError, McError
from mcserver.machine.machine_kinematics import as_configuration_error
from mcserver.terminal import LogFormatter


def _show_version(wanted: bool) -> None:
    if wanted:
        # it takes a tenth of the time that a command takes to start
        from importlib.metadata import PackageNotFoundError, version

        try:
            shown = version("mcserver")
        except PackageNotFoundError:
            shown = "(not installed: run from its sources)"
        typer.echo(f"mcserver {shown}")
        raise typer.Exit


# Module and function of each command, and what builds each group of commands, in the order of the help.
COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "run": "run.run",
        "check": "check.check",
        "fix": "fix.fix",
        "format": "fix.format_file",
        "grammar": "grammar.grammar",
        "lsp": "lsp.lsp",
        "mcp": "mcp.mcp",
        "simulate": "simulate.simulate_program",
        "certify": "certify.certify",
        "plot": "plot.plot",
        "resonance": "resonance.resonance",
        "view": "view.view",
        "web": "web.web",
        "webhooks": "webhooks.webhooks",
        "history": "history.history",
        "scan": "scan.scan",
        "gateway": "gateway.gateway",
        "mtconnect": "mtconnect.mtconnect",
        "mqtt": "mqtt.mqtt",
        "opcua": "opcua.opcua",
        "ros": "ros.ros",
        "examples": "examples.examples",
        "doctor": "doctor.doctor",
        "drive-sim": "drive_sim.drive_sim",
        "fleet-sim": "fleet_sim.fleet_sim",
    }
)
GROUPS: Mapping[str, str] = MappingProxyType(
    {
        "machine": "machine.build_app",
        "drives": "drives.build_app",
        "recordings": "recordings.build_app",
        "security": "security.build_app",
    }
)


def _imported(place: str) -> Callable[..., Any]:
    module, _, function = place.partition(".")
    found: Callable[..., Any] = getattr(import_module(f"mcserver.cli.{module}"), function)
    return found


def build_app(only: str | None = None) -> typer.Typer:
    """Build the command tree.

    Args:
        only: the command that is called, so that no other's modules are imported; None: all, as help and
            completion need them.
    """
    app = typer.Typer(
        name="mcserver",
        help="An open motion server: G-code over Zenoh to moving axes.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        # rich's own markup would take "[mm]" for a style and leave it out
        rich_markup_mode="markdown",
        context_settings={"help_option_names": ["-h", "--help"]},
    )

    @app.callback()
    def root(
        version: Annotated[
            bool, typer.Option("--version", help="Say the version.", callback=_show_version, is_eager=True)
        ] = False,
    ) -> None:
        """An open motion server: G-code over Zenoh to moving axes."""

    for name, place in COMMANDS.items():
        if only in (None, name):
            app.command(name)(_imported(place))
    for name, place in GROUPS.items():
        if only in (None, name):
            app.add_typer(_imported(place)(), name=name)
    return app


def main() -> None:
    """Entry point; leaves the process with the documented exit code."""
    sys.exit(int(run_command_line()))


def run_command_line(arguments: list[str] | None = None, app: typer.Typer | None = None) -> int:
    """Run one command line and give its exit code; every error is shown once.

    Args:
        app: of another package's command; None: ``mcserver``.
    """
    try:
        return _run(arguments, app)
    except McError as error:
        show_error(error)
        return int(exit_code_of(error))
    except KinematicsError as error:
        show_error(as_configuration_error(error))
        return int(ExitCode.CONFIGURATION)
    except BrokenPipeError:
        _abandon_standard_output()
        return int(ExitCode.FAILED)
    except OSError as error:
        _abandon_standard_output()
        show_error(_out_of_resources(error) or _from_os_error(error))
        return int(ExitCode.FAILED)
    except Exception as error:
        fault = _out_of_resources(error) or _internal(error)
        show_error(fault)
        return int(exit_code_of(fault))


def _run(arguments: list[str] | None, app: typer.Typer | None) -> int:
    if logging.lastResort is not None:
        # of commands that set up no log of their own
        logging.lastResort.setFormatter(LogFormatter())
    code: object = 0
    words = sys.argv[1:] if arguments is None else arguments
    called = words[0] if words and (words[0] in COMMANDS or words[0] in GROUPS) else None
    name = "mcserver" if app is None else app.info.name
    try:
        code = run_app(app or build_app(called), arguments, name)
    except SystemExit as done:
        code = done.code
    # a language server's library closes it when the editor says goodbye
    if sys.stdout is not None and not sys.stdout.closed:
        # what does not fit on the disk must be noticed here, not at the interpreter's end
        sys.stdout.flush()
    return code if isinstance(code, int) else int(code is not None)


def _abandon_standard_output() -> None:
    """Let the interpreter's last flush of a broken standard output go nowhere."""
    if sys.stdout is None:
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, sys.stdout.fileno())
    except (OSError, ValueError):
        return
    finally:
        os.close(nowhere)


_LACKS: Mapping[int, str] = MappingProxyType(
    {
        errno.ENOMEM: "memory",
        errno.EAGAIN: "processes or threads",
        errno.EMFILE: "file descriptors of this process",
        errno.ENFILE: "file descriptors",
    }
)


def _out_of_resources(error: BaseException) -> McError | None:
    """Name what the computer, or a limit of this process, does not give; None: it is no such error."""
    lacking = ""
    if isinstance(error, BaseExceptionGroup):
        return next(filter(None, map(_out_of_resources, error.exceptions)), None)
    if isinstance(error, MemoryError):
        lacking = _LACKS[errno.ENOMEM]
    elif isinstance(error, RuntimeError) and "can't start new thread" in str(error):
        lacking = "memory or threads"
    elif isinstance(error, ImportError) and ("map segment" in str(error) or "allocate memory" in str(error)):
        # a library that is loaded late
        lacking = _LACKS[errno.ENOMEM]
    elif isinstance(error, OSError):
        lacking = _LACKS.get(error.errno or 0, "")
    if not lacking:
        return None
    return OutOfResources(
        "MC028",
        f"the computer gives no more {lacking}",
        "end other programs, or raise the limits of this process (ulimit -v, -u, -n; MemoryMax, TasksMax and "
        "LimitNOFILE of its service); a server needs 1.5 GB of address space, 350 MB of memory",
    )


def _from_os_error(error: OSError) -> McError:
    reason = error.strerror or str(error)
    where = f" ({error.filename})" if error.filename else ""
    if error.errno == errno.ENOSPC:
        return OutputFault(
            "MC015", f"the output could not be written: {reason}{where}", "make room on the disk"
        )
    return OutputFault(
        "MC015", f"the operating system refused: {reason}{where}", "check the file or device named"
    )


def _internal(error: Exception) -> McError:
    if os.environ.get("MCSERVER_TRACEBACK"):
        for line in traceback.format_exc().splitlines():
            narration().print(line)
    if isinstance(error, ModuleNotFoundError) and error.name in sys.stdlib_module_names:
        return ConfigurationError(
            "MC025", f"this command needs the module {error.name}, which Python has on Linux", NEEDS_LINUX
        )
    frames = traceback.extract_tb(error.__traceback__)
    place = f" at {os.path.basename(frames[-1].filename)}:{frames[-1].lineno}" if frames else ""
    return McError(
        "MC019",
        f"a fault of mcserver itself{place}: {type(error).__name__}: {error}",
        "please report it with the program; MCSERVER_TRACEBACK=1 shows where it comes from",
    )
