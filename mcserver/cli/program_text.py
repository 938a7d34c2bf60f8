"""A program's text with what is needed to show its faults."""

from __future__ import annotations

import msgspec

from mcserver.cli.program_file import read_program, shown_name
from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.text.source import decode, split_lines
from mcserver.machine.program_bytes import text_of_lines


class ProgramText(msgspec.Struct, frozen=True):
    """A program as read.

    Attributes:
        name: what diagnostics call it.
        text: decoded; as it may be shown where there are ``faults``.
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
        text = text_of_lines(raw, strict=False)
        faults = error.diagnostics
    return ProgramText(name=shown_name(file), text=text, lines=split_lines(text), faults=faults)
