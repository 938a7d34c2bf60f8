"""A program's text with what is needed to show its faults."""

from __future__ import annotations

import msgspec

from mcserver.cli.program_file import read_program, shown_name
from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.text.source import decode, split_lines


class ProgramText(msgspec.Struct, frozen=True):
    """A program as read.

    Attributes:
        name: what diagnostics call it.
        text: decoded; undecodable bytes are replaced where there are ``faults``.
        lines: the text's lines.
        faults: what kept the bytes from being text; empty otherwise.
    """

    name: str
    text: str
    lines: list[str]
    faults: tuple[Diagnostic, ...]


def load_program(file: str) -> ProgramText:
    """Read and decode ``file`` (``-``: standard input).

    Raises:
        UsageFault: MC010, MC011 (`read_program`).
    """
    raw = read_program(file)
    faults: tuple[Diagnostic, ...] = ()
    try:
        text = decode(raw)
    except ProgramRejected as error:
        text = raw.decode("utf-8", errors="replace")
        faults = error.diagnostics
    return ProgramText(name=shown_name(file), text=text, lines=split_lines(text), faults=faults)
