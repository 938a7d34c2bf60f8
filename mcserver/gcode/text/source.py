"""Decode a program file and split it into lines (D-01)."""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Callable, Iterable, Iterator

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.machine.program_bytes import NoText, text_of_bytes, text_of_lines

BOM = "\ufeff"
# Longest line that a machine accepts [characters].
MAX_LINE_LENGTH = 8192
# Most bytes without a line end; the rest is cut off, as it is not a line and must not fill memory.
MAX_PIECE_BYTES = 1 << 16

# Source of a program's lines, without line ends: each call begins at the first line.
LineSource = Callable[[], Iterator[str]]


def decode(raw: bytes) -> str:
    """Decode a program file, without its byte order mark.

    Raises:
        ProgramRejected: MC100 at the first line that is not text.
    """
    try:
        return text_of_bytes(raw)
    except NoText as error:
        raise _rejected(raw, error, 0) from error


def lines_of(blocks: Iterable[bytes], *, strict: bool = True) -> Iterator[str]:
    """Decode and split a program in blocks, as `decode` and `split_lines` do for the whole of it.

    A piece of more than `MAX_PIECE_BYTES` without a line end is the last line.

    Args:
        strict: raise for bytes that are not text; else replace them for display.

    Raises:
        ProgramRejected: MC100 at the first line that is not text.
    """
    pending, number = b"", 0
    for block in blocks:
        whole, end, rest = block.rpartition(b"\n")
        if end:
            lines = _split(_decoded(pending + whole + end, number, strict))
            number += len(lines)
            yield from lines
            pending = rest
        else:
            pending += rest
        if len(pending) > MAX_PIECE_BYTES:
            break
    if pending:
        yield from _split(_decoded(pending, number, strict))


def _decoded(raw: bytes, before: int, strict: bool) -> str:
    """Decode complete lines that follow ``before`` others."""
    try:
        text = text_of_lines(raw if before else raw.removeprefix(BOM_UTF8), strict=strict)
    except NoText as error:
        raise _rejected(raw, error, before) from error
    # the byte order mark is removed as by `decode` and `split_lines`
    return text if before else text.removeprefix(BOM)


def _rejected(raw: bytes, error: NoText, lines_before: int) -> ProgramRejected:
    wide = not lines_before and raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    return ProgramRejected(
        [
            Diagnostic(
                code="MC100",
                message="the line is of no text file: it has a byte 0",
                line=lines_before + error.line,
                column=error.column,
                end_column=error.column + 1,
                hint="the file looks like UTF-16; save it as UTF-8" if wide else "is it the right file?",
            )
        ]
    )


def split_lines(text: str) -> list[str]:
    """Split a text into lines without their ends: LF, CR LF or CR CR LF; a lone CR stays (D-01)."""
    return _split(text.removeprefix(BOM))


def _split(text: str) -> list[str]:
    pieces = text.split("\n")
    last = pieces.pop()
    if "\r" not in text:
        return [*pieces, last] if last else pieces
    lines = [piece.rstrip("\r") if piece.endswith("\r") else piece for piece in pieces]
    if last:
        lines.append(last)
    return lines


def find_odd_line(lines: list[str], first: int = 1) -> Diagnostic | None:
    """Return the fault of the first line that no machine accepts (MC156): too long, or a whole file whose
    lines end with CR alone. A CR in one of several lines is a fault of that line.

    Args:
        lines: of the file, from line ``first`` on.
    """
    if max(map(len, lines), default=0) <= MAX_LINE_LENGTH and not (first == 1 and len(lines) == 1):
        return None
    for number, text in enumerate(lines, start=first):
        one = number == 1 and len(lines) == 1 and "\r" in text
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
