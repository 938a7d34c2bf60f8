"""Split a line's text into tokens: by one regular expression if it is correct, else by `lexical_errors`."""

from __future__ import annotations

import re

import msgspec

from mcserver.errors import Edit
from mcserver.gcode.line_faults import FaultList, Span
from mcserver.gcode.text.lexical_errors import scan_faulty

# name, number, any other character; blanks match no group
TOKEN = re.compile(
    r"([A-CFGI-KMNPRT-Z]|\[[ \t]*[0-9]{1,3}[ \t]*\])[ \t]*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))|([^ \t])"
)
_OPENED = re.compile(r"[(;]")
Token = tuple[str, str, str]


class Scan(msgspec.Struct, frozen=True):
    """The tokens of one line.

    Attributes:
        code: the text with comments blanked, so that columns stay.
        tokens: (name, number, "") for words, ("", "", ",") for commas.
        spans: columns of each token if `lexical_errors` has found them; None: `token_spans` computes them.
    """

    code: str
    tokens: list[Token]
    spans: list[Span] | None = None


def scan(text: str, faults: FaultList) -> Scan:
    """Tokenize a line; report every lexical fault to ``faults`` and replace it by a best guess (D-01)."""
    code = text
    if "(" in code or ";" in code:
        code = blank_comments(text, faults)
    if code.isascii():
        code = code.upper()
        tokens: list[Token] = TOKEN.findall(code)
        for token in tokens:
            if token[2] and token[2] != ",":
                break
        else:
            return Scan(code, tokens)
    tokens, spans = scan_faulty(code, faults)
    return Scan(code, tokens, spans)


def token_spans(code: str) -> list[Span]:
    """Return the columns of the tokens of ``code``, in code points from 1, end exclusive."""
    return [(match.start() + 1, match.end() + 1) for match in TOKEN.finditer(code)]


def blank_comments(text: str, faults: FaultList) -> str:
    """Replace comments by blanks of the same length, so that columns stay.

    Comments do not nest; ``;`` inside ``( )`` is text; an unclosed ``(`` is a fault (D-01).
    """
    pieces: list[str] = []
    position = 0
    while (match := _OPENED.search(text, position)) is not None:
        start = match.start()
        pieces.append(text[position:start])
        if match[0] == ";":
            end = len(text)
        else:
            close = text.find(")", start)
            if close < 0:
                faults.add("MC106", "the comment is not closed", (start + 1, start + 2), "add a closing ')'")
                end = len(text)
            else:
                end = close + 1
                stray = _nested_end(text, start, end)
                if stray:
                    faults.add(
                        "MC106",
                        "a comment ends at its first ')': this one closes nothing",
                        (stray, stray + 1),
                        "comments do not nest; take the inner parentheses out",
                        edit=Edit(start + 1, stray + 1, _flat_comment(text[start:stray])),
                    )
                    end = stray
        pieces.append(" " * (end - start))
        position = end
    pieces.append(text[position:])
    return "".join(pieces)


def _flat_comment(nested: str) -> str:
    """Return a nested comment as a single one, without its inner parentheses."""
    return f"({nested.replace('(', '').replace(')', '')})"


def _nested_end(text: str, start: int, end: int) -> int:
    """Return the index after the ``)`` that was meant to end a nested comment, or 0 if none was."""
    depth = text.count("(", start, end) - 1
    if depth == 0:
        return 0
    position = end
    last = 0
    while depth > 0:
        position = text.find(")", position) + 1
        if position == 0 or text.find("(", end, position) >= 0:
            break
        last = position
        depth -= 1
    return last
