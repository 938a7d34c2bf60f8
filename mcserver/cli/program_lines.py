"""A program read from its file line by line, as often as it is asked for; kept are only lines to be shown."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import IO, overload

from mcserver.cli.program_file import MAX_PROGRAM_BYTES, STDIN, open_program, shown_name
from mcserver.cli.terminal_console import MAX_SHOWN_DIAGNOSTICS
from mcserver.errors import Diagnostic, UsageFault
from mcserver.gcode.repeated import by_cause
from mcserver.gcode.text.source import lines_of

BLOCK_BYTES = 1 << 20


class ProgramLines(Sequence[str]):
    """Lines of an open file, which does not change while it is read.

    Args:
        file: can be read at any place. name: what diagnostics call it.
    """

    def __init__(self, file: IO[bytes], name: str) -> None:
        self.name = name
        self._file = file
        self._count: int | None = None
        self._kept: dict[int, str] = {}

    def source(self) -> Iterator[str]:
        """Read the lines from the first one on.

        Raises:
            ProgramRejected: MC100 at the first line that is no text.
        """
        return lines_of(self._blocks())

    def keep(self, numbers: Iterable[int]) -> None:
        """Read lines by their numbers from 1, which are going to be shown, in one pass."""
        wanted = sorted({number for number in numbers if number > 0} - self._kept.keys())
        position = 0
        lines = self._lenient()
        for number in wanted:
            found = next(islice(lines, number - position - 1, None), None)
            if found is None:
                return
            self._kept[number] = found
            position = number

    def has_more_than(self, count: int) -> bool:
        """Return whether there are more lines than so many; reads no further."""
        return next(islice(self._lenient(), count, None), None) is not None

    def __len__(self) -> int:
        if self._count is None:
            count, last = 0, b"\n"
            for block in self._blocks():
                count += block.count(b"\n")
                last = block[-1:]
            self._count = count + (last != b"\n")
        return self._count

    @overload
    def __getitem__(self, index: int, /) -> str: ...
    @overload
    def __getitem__(self, index: slice, /) -> list[str]: ...
    def __getitem__(self, index: int | slice, /) -> str | list[str]:
        if isinstance(index, slice):
            return [self[each] for each in range(*index.indices(len(self)))]
        self.keep([index + 1])
        if index + 1 not in self._kept:
            raise IndexError(index)
        return self._kept[index + 1]

    def _lenient(self) -> Iterator[str]:
        """Read the lines, also those that are no text: to be shown."""
        return lines_of(self._blocks(), strict=False)

    def _blocks(self) -> Iterator[bytes]:
        offset = 0
        while True:
            # others may have read elsewhere meanwhile; Windows has no pread
            self._file.seek(offset)
            block = self._file.read(BLOCK_BYTES)
            if not block:
                return
            yield block
            offset += len(block)


def keep_shown(program: ProgramLines, diagnostics: Sequence[Diagnostic]) -> None:
    """Read the lines that go with diagnostics when they are shown."""
    program.keep(first.line for first, _ in by_cause(diagnostics)[:MAX_SHOWN_DIAGNOSTICS])


@contextmanager
def program_lines(file: str) -> Iterator[ProgramLines]:
    """Open a program (``-``: standard input) to be read line by line inside the block.

    What cannot be read twice is copied to a temporary file first.

    Raises:
        UsageFault: MC010 it cannot be read, MC011 a pipe gives more than 512 MiB.
    """
    with open_program(file) as stream:
        if file != STDIN and stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            yield ProgramLines(stream, shown_name(file))
            return
        with tempfile.TemporaryFile() as copy:
            _copy(stream, copy, shown_name(file))
            yield ProgramLines(copy, shown_name(file))


def _copy(stream: IO[bytes], copy: IO[bytes], name: str) -> None:
    size = 0
    while block := stream.read(BLOCK_BYTES):
        size += len(block)
        if size > MAX_PROGRAM_BYTES:
            raise UsageFault(
                "MC011",
                f"{name} gives more than {MAX_PROGRAM_BYTES >> 20} MiB",
                "save it as a file, or stream it with mcctl run",
            )
        copy.write(block)
    copy.flush()
