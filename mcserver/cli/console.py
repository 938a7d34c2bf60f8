"""Where words go: results to standard output, narration and faults to standard error.

NO_COLOR, a pipe and a dumb terminal all give plain text.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, TextIO

import msgspec
from rich.console import Group
from rich.text import Text

from mcserver.cli.exit_codes import OutputFault
from mcserver.cli.terminal_console import TerminalConsole
from mcserver.errors import Diagnostic, McError, ProgramRejected, RuntimeFault
from mcserver.gcode.render import render
from mcserver.gcode.repeated import by_cause, further_lines
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.terminal import LogFormatter, visible, visible_json

MAX_SHOWN_DIAGNOSTICS = 100


class NarrationHandler(logging.Handler):
    """Writes a process's log to standard error: when, how grave, what; a traceback below it."""

    STYLES = MappingProxyType({"WARNING": "yellow", "ERROR": "bold red", "CRITICAL": "bold red"})

    def __init__(self) -> None:
        super().__init__()
        self.setFormatter(LogFormatter())

    def emit(self, record: logging.LogRecord) -> None:
        """Called by `logging`."""
        try:
            # what the formatter parts by line ends are lines of ours
            head, *rest = self.format(record).split("\n")
            when = time.strftime("[%H:%M:%S] ", time.localtime(record.created))
            level = (f"{record.levelname:<8} ", self.STYLES.get(record.levelname, ""))
            narration().print(Group(Text.assemble((when, "dim"), level, head), *map(Text, rest)))
        except Exception:
            self.handleError(record)


def narration() -> TerminalConsole:
    """Return the console for people: standard error."""
    return TerminalConsole(stderr=True, soft_wrap=True)


def results() -> TerminalConsole:
    """Return the console for results: standard output."""
    console = TerminalConsole(soft_wrap=True)
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
    sys.stdout.buffer.write(json_bytes(answer) + b"\n")
    sys.stdout.flush()


def json_bytes(value: object) -> bytes:
    """Return a value as JSON in which a terminal has nothing to obey."""
    return visible_json(msgspec.json.encode(value).decode()).encode()


def write_text(text: str, stream: TextIO | None = None) -> None:
    """Write a text as it is, by default to standard output; at a terminal nothing in it is obeyed."""
    stream = sys.stdout if stream is None else stream
    if stream.isatty():
        text = "\n".join(map(visible, text.split("\n")))
    stream.write(text)
    stream.flush()


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
        head, *rest = render(diagnostic, source_lines, path)
        colour = "bold red" if diagnostic.severity == "error" else "bold yellow"
        console.print(Text(head, style=colour))
        for line in rest:
            console.print(Text(line))
        if lines:
            console.print(Text(f"  = {further_lines(lines)}"))
        console.print()
    if len(causes) > MAX_SHOWN_DIAGNOSTICS:
        console.print(f"… and {len(causes) - MAX_SHOWN_DIAGNOSTICS} more; --json gives all of them")


def as_diagnostics(error: McError) -> list[dict[str, Any]]:
    """Return what a JSON answer says of an error."""
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
