"""The one way to a terminal: words of machines, programs and people as text, never as orders to it.

Results go to standard output, narration and faults to standard error. NO_COLOR, a pipe and a dumb terminal
all give plain text.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, TextIO

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Span, Text

from mcserver.errors import Diagnostic
from mcserver.gcode.render import render
from mcserver.gcode.repeated import by_cause, further_lines
from mcserver.terminal import shown, visible

MAX_SHOWN_DIAGNOSTICS = 100
# Of a file or a pipe, which has no width: tables need not be squeezed.
PIPE_COLUMNS = 160


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


def narration() -> TerminalConsole:
    """Return the console for people: standard error."""
    return TerminalConsole(stderr=True, soft_wrap=True)


def results() -> TerminalConsole:
    """Return the console for results: standard output."""
    console = TerminalConsole(soft_wrap=True)
    if not console.is_terminal:
        console.width = max(console.width, PIPE_COLUMNS)
    return console


def write_text(text: str, stream: TextIO | None = None) -> None:
    """Write a text as it is, by default to standard output; at a terminal nothing in it is obeyed."""
    stream = sys.stdout if stream is None else stream
    if stream.isatty():
        text = "\n".join(map(visible, text.split("\n")))
    stream.write(text)
    stream.flush()


def show_diagnostics(
    diagnostics: Sequence[Diagnostic],
    text_of: Callable[[int], str | None],
    path: str,
    titles: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Show faults of a program as a compiler would, each cause once, on standard error.

    Args:
        text_of: the text of a line, None where it is not known. path: name of the program. titles: of codes.
    """
    console = narration()
    causes = by_cause(diagnostics)
    for diagnostic, lines in causes[:MAX_SHOWN_DIAGNOSTICS]:
        head, *rest = render(diagnostic, text_of(diagnostic.line), path, titles.get(diagnostic.code, ""))
        console.print(Text(head, style="bold red" if diagnostic.severity == "error" else "bold yellow"))
        for line in rest:
            console.print(Text(line))
        if lines:
            console.print(Text(f"  = {further_lines(lines)}"))
        console.print()
    if len(causes) > MAX_SHOWN_DIAGNOSTICS:
        console.print(f"… and {len(causes) - MAX_SHOWN_DIAGNOSTICS} more; --json gives all of them")


def run_app(app: typer.Typer, arguments: Sequence[str] | None, name: str | None) -> int:
    """Run a command line and return its exit code; words that it does not take are shown as text.

    Args:
        arguments: None: those of the process. name: of the command, for its usage.
    """
    try:
        code = app(args=arguments, prog_name=name, standalone_mode=False)
    except typer.Abort:
        TerminalConsole(stderr=True).print("Aborted.")
        return 1
    except Exception as error:
        # typer has its own copy of click, whose errors of usage are told by what they can do
        if not hasattr(error, "format_message") or not hasattr(error, "exit_code"):
            raise
        shown_error: Any = error
        for words in ("message", "ui_filename"):
            if isinstance(said := getattr(error, words, None), str):
                setattr(error, words, visible(said))
        # it loads a reader of Markdown, a tenth of the time that a command takes to start
        from typer.rich_utils import rich_format_error

        rich_format_error(shown_error)
        return int(shown_error.exit_code)
    return code if isinstance(code, int) else 0
