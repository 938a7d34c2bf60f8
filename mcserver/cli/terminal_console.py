"""The one way to a terminal: words of machines, programs and people as text, never as orders to it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Span, Text

from mcserver.terminal import shown, visible


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
