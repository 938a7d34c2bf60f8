"""Where words go: results to standard output, narration and faults to standard error.

NO_COLOR, a pipe and a dumb terminal all give plain text.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, TextIO

import msgspec
from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.segment import Segment
from rich.text import Span, Text

from mcserver.cli.exit_codes import OutputFault
from mcserver.errors import Diagnostic, McError, ProgramRejected, RuntimeFault
from mcserver.gcode.render import render
from mcserver.gcode.repeated import by_cause, further_lines
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.terminal import LogFormatter, shown, visible, visible_json

MAX_SHOWN_DIAGNOSTICS = 100


class TerminalConsole(Console):
    """A console that obeys nothing of what it prints: neither rich's markup nor a terminal's controls.

    Whatever is printed is one line: who has several prints each, or a `rich.console.Group` of them.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Called by rich for each plain string."""
        return super().render_str(visible(text), **{**options, "markup": False, "emoji": False})

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Called by rich for whatever is printed, and for each cell and line in it."""
        return super().render(_visible(renderable) if isinstance(renderable, Text) else renderable, options)


def _visible(text: Text) -> Text:
    if text.plain.isprintable():
        return text
    pieces = [shown(character) for character in text.plain]
    at = [0]
    for piece in pieces:
        at.append(at[-1] + len(piece))
    whole = text.blank_copy("".join(pieces))
    whole.spans = [Span(at[span.start], at[min(span.end, len(pieces))], span.style) for span in text.spans]
    return whole


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
    """The console for people: standard error."""
    return TerminalConsole(stderr=True, soft_wrap=True)


def results() -> TerminalConsole:
    """The console for results: standard output."""
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
