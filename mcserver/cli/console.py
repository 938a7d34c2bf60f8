"""Where words go: results to standard output, narration and faults to standard error.

NO_COLOR, a pipe and a dumb terminal all give plain text.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import msgspec
from rich.console import Console
from rich.text import Text

from mcserver.cli.exit_codes import OutputFault
from mcserver.errors import Diagnostic, McError, ProgramRejected, RuntimeFault
from mcserver.gcode.render import render
from mcserver.gcode.repeated import by_cause, further_lines
from mcserver.machine.section_reader import MachineFileRejected

MAX_SHOWN_DIAGNOSTICS = 100


def narration() -> Console:
    """The console for people: standard error."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def results() -> Console:
    """The console for results: standard output."""
    console = Console(highlight=False, soft_wrap=True)
    if not console.is_terminal:
        # a file or a pipe has no width: tables need not be squeezed
        console.width = max(console.width, 140)
    return console


def write_json(answer: object) -> None:
    """One JSON object and a line end on standard output.

    Raises:
        OutputFault: MC015 standard output is closed.
        OSError: it could not be written (full disk, reader gone).
    """
    if sys.stdout is None:
        raise OutputFault("MC015", "standard output is closed", "give it a file or a pipe")
    sys.stdout.buffer.write(msgspec.json.encode(answer) + b"\n")
    sys.stdout.flush()


def show_error(error: McError) -> None:
    """A coded error with its remedy, on standard error."""
    console = narration()
    if isinstance(error, MachineFileRejected):
        show_diagnostics(error.diagnostics, error.lines, error.source)
        return
    console.print(Text.assemble((f"error[{error.code}]", "bold red"), f": {error.message}"))
    if error.hint:
        console.print(Text.assemble("  = ", ("help", "bold"), f": {error.hint}"))


def show_diagnostics(diagnostics: Sequence[Diagnostic], source_lines: Sequence[str], path: str) -> None:
    """Show faults of a program as a compiler would, each cause once, on standard error."""
    console = narration()
    causes = by_cause(diagnostics)
    for diagnostic, lines in causes[:MAX_SHOWN_DIAGNOSTICS]:
        head, _, rest = render(diagnostic, source_lines, path).partition("\n")
        colour = "bold red" if diagnostic.severity == "error" else "bold yellow"
        console.print(Text(head, style=colour))
        if rest:
            console.print(Text(rest))
        if lines:
            console.print(Text(f"  = {further_lines(lines)}"))
        console.print()
    if len(causes) > MAX_SHOWN_DIAGNOSTICS:
        console.print(f"… and {len(causes) - MAX_SHOWN_DIAGNOSTICS} more; --json gives all of them")


def as_diagnostics(error: McError) -> list[dict[str, Any]]:
    """What a JSON answer says of an error."""
    if isinstance(error, ProgramRejected | MachineFileRejected):
        return [diagnostic.as_json() for diagnostic in error.diagnostics]
    if isinstance(error, RuntimeFault):
        return [error.diagnostic().as_json()]
    return [Diagnostic(code=error.code, message=error.message, hint=error.hint).as_json()]


@contextmanager
def json_answer_on_error(wanted: bool, answer: Mapping[str, Any] | None = None) -> Iterator[None]:
    """With ``--json`` a reader gets an object whatever happens; the error goes on to standard error.

    ``answer`` is what the object holds besides ``ok`` and ``diagnostics``.
    """
    try:
        yield
    except McError as error:
        if wanted:
            write_json({**(answer or {}), "ok": False, "diagnostics": as_diagnostics(error)})
        raise
