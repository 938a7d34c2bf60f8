"""Comments with a meaning: (MSG, …) for the operator, the tool to fit (D-65, D-76), (BODY, …)."""

from __future__ import annotations

import re
from collections.abc import Sequence

from mcserver.motion.canonical import Canonical, PauseLine

LONGEST = 200  # characters
MESSAGE = re.compile(r"\([ \t]*(?:MSG|DEBUG|PRINT)[ \t]*,([^()]*)\)", re.IGNORECASE)
# comments that write a file in LinuxCNC
_LOGGING = re.compile(r"\([ \t]*((?:PROBE|LOG)(?:OPEN|CLOSE|APPEND)|LOG(?=[ \t]*,))", re.IGNORECASE)
# a comment that adds a body, also without its end or the comma after its first word (D-131)
_HEAD = r"\([ \t]*BODY\b(?:[ \t]*,|(?=[^()]*,[ \t]*(?:box|cylinder|capsule|sphere|mesh)[ \t]*,))"
_BODY = re.compile(rf"{_HEAD}([^()]*)\)?|\([^()]*\)|;.*", re.IGNORECASE)
_BRINGS = re.compile(_HEAD, re.IGNORECASE)
_COMMENT = re.compile(r"\(([^()]*)\)|;(.*)")
# M117, and M0 or M1 of printers with a text
DISPLAY = re.compile(
    r"[ \t]*(?:N[0-9]+[ \t]*)?M(?:117(?![0-9])|0{0,2}[01](?=[ \t]+[A-Z]{2}))([^;]*)", re.IGNORECASE
)


def notice_of(text: str, values: Sequence[Canonical], *, printer: bool = False) -> str | None:
    """Return the message of a line for the operator, or None.

    Args:
        values: what the line means; for a pause the message is its reason, or the line's comment.
        printer: texts of M117, M0 and M1 are messages.
    """
    pause = next((value for value in values if isinstance(value, PauseLine)), None)
    if pause is not None and pause.notice:
        return pause.notice
    shown = MESSAGE.search(text)
    if shown is not None:
        return _cut(shown[1])
    if printer and (display := DISPLAY.match(text)) is not None:
        return _cut(display[1])
    if pause is not None and (comment := _COMMENT.search(text)) is not None:
        return _cut(comment[1] or comment[2] or "") or None
    return None


def logging_of(text: str) -> tuple[str, ...]:
    """Return the comments of a line that write a file in LinuxCNC, which is not done here."""
    return tuple(f"({each.upper()})" for each in _LOGGING.findall(text)) if "(" in text else ()


def bodies_in(text: str) -> list[re.Match[str]]:
    """Return the comments of a line that add a body; group 1 is the description."""
    if _BRINGS.search(text) is None:
        return []
    return [each for each in _BODY.finditer(text) if each[1] is not None]


def speaks(text: str) -> re.Match[str] | None:
    """Return the first comment of a text that has a meaning."""
    found = [
        each
        for each in (MESSAGE.search(text), _LOGGING.search(text), _BRINGS.search(text))
        if each is not None
    ]
    return min(found, key=lambda each: each.start(), default=None)


def _cut(text: str) -> str:
    return "".join(each for each in text.strip() if each.isprintable())[:LONGEST]
