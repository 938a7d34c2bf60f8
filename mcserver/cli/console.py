"""Where words go: results, errors and diagnostics of the commands, for people or as JSON."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any

import msgspec
from rich.console import Group
from rich.text import Text

from mcserver.cli import terminal_console
from mcserver.cli.exit_codes import OutputFault
from mcserver.cli.terminal_console import narration as narration
from mcserver.cli.terminal_console import results as results
from mcserver.cli.terminal_console import write_text as write_text
from mcserver.errors import Diagnostic, McError, ProgramRejected, RuntimeFault
from mcserver.gcode.line_faults import TITLES
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.terminal import LogFormatter, visible_json


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
    """Show faults of a program, with the lines where they are."""

    def text_of(line: int) -> str | None:
        return source_lines[line - 1] if 0 < line <= len(source_lines) else None

    terminal_console.show_diagnostics(diagnostics, text_of, path, TITLES)


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
