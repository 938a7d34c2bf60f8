"""Decode a program file and split it into lines (D-01)."""

from __future__ import annotations

from mcserver.errors import Diagnostic, ProgramRejected

BOM = "\ufeff"
# The longest line of a program that a machine takes, in characters.
MAX_LINE_LENGTH = 8192


def decode(raw: bytes) -> str:
    """Decode a program file, without its byte order mark.

    Raises:
        ProgramRejected: MC100 at the first byte that is not UTF-8.
    """
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        line_start = before.rfind(b"\n") + 1
        column = len(before[line_start:].decode("utf-8").removeprefix(BOM)) + 1
        hint = "save the file as UTF-8"
        if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
            hint = "the file looks like UTF-16; save it as UTF-8"
        raise ProgramRejected(
            [
                Diagnostic(
                    code="MC100",
                    message=f"the byte 0x{raw[error.start]:02X} is not UTF-8",
                    line=before.count(b"\n") + 1,
                    column=column,
                    end_column=column + 1,
                    hint=hint,
                )
            ]
        ) from error
    return text.removeprefix(BOM)


def split_lines(text: str) -> list[str]:
    """Split a text into lines without their ends: LF, CR LF or CR CR LF; a lone CR stays (D-01)."""
    pieces = text.removeprefix(BOM).split("\n")
    last = pieces.pop()
    lines = [piece.rstrip("\r") if piece.endswith("\r") else piece for piece in pieces]
    if last:
        lines.append(last)
    return lines


def find_odd_line(lines: list[str]) -> Diagnostic | None:
    """Return the fault of the first line that no machine takes (MC156): too long, or a whole file whose lines
    end with CR alone. A CR in one of several lines is a fault of that line.
    """
    for number, text in enumerate(lines, start=1):
        one = len(lines) == 1 and "\r" in text
        if len(text) <= MAX_LINE_LENGTH and not one:
            continue
        if one:
            column = text.index("\r") + 1
            message = "the lines end with CR alone, as on old Macs: the file is one line"
            hint = "save the file with lines that end with LF"
        else:
            column = MAX_LINE_LENGTH + 1
            message = f"the line has {len(text)} characters; {MAX_LINE_LENGTH} are the most"
            hint = "is it a G-code file? Blocks belong on lines of their own"
        return Diagnostic(
            code="MC156", message=message, line=number, column=column, end_column=column + 1, hint=hint
        )
    return None
