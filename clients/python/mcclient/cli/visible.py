# mcserver/terminal.py, by python -m mcserver.contract.sdk clients: change it there
"""What a terminal or a log is given: words of clients, drives and programs as text, never as orders to it.

A name, a reason or a line of a program may hold what a terminal obeys (ESC, OSC, C1 controls) or what turns
and parts its lines (line ends, bidirectional controls). All of it is shown by its number.
"""

from __future__ import annotations

import json
import logging
import re
import unicodedata

# categories of Unicode: controls, format characters (among them the bidirectional ones), lone surrogates,
# line and paragraph separators
OBEYED = ("Cc", "Cf", "Cs", "Zl", "Zp")
_NOT_ASCII = re.compile(r"[^ -~]")


def visible(text: str) -> str:
    r"""Return a text with each character that a terminal would obey written as ``\x1b`` or ``<U+202E>``."""
    return text if text.isprintable() else "".join(map(shown, text))


def shown(character: str) -> str:
    """Return how a single character is shown; tabs stay."""
    if character == "\t" or unicodedata.category(character) not in OBEYED:
        return character
    code = ord(character)
    names = {0x0A: r"\n", 0x0D: r"\r"}
    return names.get(code) or (rf"\x{code:02x}" if code < 0x100 else f"<U+{code:04X}>")


def visible_json(text: str) -> str:
    """Return JSON with each character that a terminal would obey as its ``\\u`` escape: the same value."""
    return _NOT_ASCII.sub(lambda found: _escaped(found[0]), text)


def _escaped(character: str) -> str:
    return character if shown(character) == character else json.dumps(character)[1:-1]


class LogFormatter(logging.Formatter):
    """Writes a record's message as one line, and a traceback indented below it: no words make a line."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802
        """Called by `format` for the message."""
        record.message = visible(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: object) -> str:  # noqa: N802
        """Called by `format` for the traceback."""
        return "\n".join(f"  {visible(line)}" for line in super().formatException(ei).split("\n"))  # type: ignore[arg-type]
