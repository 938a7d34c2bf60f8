"""The one way to a terminal: words of machines, programs and people come out as text, never as orders to it.

A name, a reason or a line of a program may hold what a terminal obeys (ESC, OSC, C1 controls) or what turns
and parts its lines (line ends, bidirectional controls). All of it is shown by its number. Whatever is printed
is one line: who has several prints each, or a `rich.console.Group` of them.
"""

from __future__ import annotations

import json
import logging
import re
import unicodedata
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Span, Text

# categories of Unicode: controls, format characters (among them the bidirectional ones), lone surrogates,
# line and paragraph separators
OBEYED = ("Cc", "Cf", "Cs", "Zl", "Zp")
_NOT_ASCII = re.compile(r"[^ -~]")


def visible(text: str) -> str:
    r"""Return a text with each character that a terminal would obey written as ``\x1b`` or ``<U+202E>``."""
    return text if text.isprintable() else "".join(map(_shown, text))


def _shown(character: str) -> str:
    if character == "\t" or unicodedata.category(character) not in OBEYED:
        return character
    code = ord(character)
    names = {0x0A: r"\n", 0x0D: r"\r"}
    return names.get(code) or (rf"\x{code:02x}" if code < 0x100 else f"<U+{code:04X}>")


def visible_json(text: str) -> str:
    """Return JSON with each character that a terminal would obey as its ``\\u`` escape: the same value."""
    return _NOT_ASCII.sub(lambda found: _escaped(found[0]), text)


def _escaped(character: str) -> str:
    return character if _shown(character) == character else json.dumps(character)[1:-1]


class TerminalConsole(Console):
    """A console that obeys nothing of what it prints: neither rich's markup nor a terminal's controls."""

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
    pieces = [_shown(character) for character in text.plain]
    at = [0]
    for piece in pieces:
        at.append(at[-1] + len(piece))
    shown = text.blank_copy("".join(pieces))
    shown.spans = [Span(at[span.start], at[min(span.end, len(pieces))], span.style) for span in text.spans]
    return shown


class OneLineFormatter(logging.Formatter):
    """Writes each record of a log as one line."""

    def format(self, record: logging.LogRecord) -> str:
        """Called by a handler."""
        return visible(super().format(record))
