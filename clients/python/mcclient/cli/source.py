"""The program's text: read once, line by line; only what is under way is kept."""

from __future__ import annotations

import contextlib
import os
import sys
from codecs import BOM_UTF8
from collections import deque
from collections.abc import Iterator
from itertools import islice
from typing import BinaryIO

from mcclient.errors import RequestRefused
from mcclient.texts import text_of_line, text_of_program

# a text that is not a line file at all must not fill the memory
MAX_LINE_BYTES = 1 << 20
COUNT_BYTES = 1 << 20


class ProgramSource:
    """A file, or standard input for ``-``.

    Attributes:
        name: for people.
        total: how many lines there are; None: not known before they are read.
    """

    def __init__(self, path: str) -> None:
        """Raises RequestRefused (MC511) where it cannot be read."""
        self.name = "standard input" if path == "-" else os.path.basename(path)
        self.path = path
        self.total: int | None = None
        self._kept: deque[tuple[int, str]] = deque()
        self._read = 0
        if path == "-":
            self._stream: BinaryIO = sys.stdin.buffer
            return
        try:
            self._stream = open(path, "rb")  # noqa: SIM115 closed by `close`
            if self._stream.seekable():
                self.total = _count_lines(self._stream)
        except OSError as error:
            raise RequestRefused(
                "MC511", f"{path} cannot be read: {error.strerror or error}", "name a G-code file, or -"
            ) from error

    @property
    def is_stdin(self) -> bool:
        return self.path == "-"

    def whole_text(self, limit: int) -> str | None:
        """Return all of a file of at most ``limit`` bytes; None: it is longer, or cannot be read twice.

        Raises:
            RequestRefused: MC511 it is no text.
        """
        if self.total is None or os.path.getsize(self.path) > limit:
            return None
        with open(self.path, "rb") as file:
            return text_of_program(file.read(), self.name)

    def lines(self) -> Iterator[str]:
        """The lines from where reading stands, without line ends; keeps them until `forget`.

        Raises:
            RequestRefused: MC511 it is no text with lines.
        """
        while line := self._stream.readline(MAX_LINE_BYTES):
            if len(line) >= MAX_LINE_BYTES:
                raise RequestRefused("MC511", f"{self.name} has a line of a megabyte", "is it a G-code file?")
            self._read += 1
            if self._read == 1:
                line = line.removeprefix(BOM_UTF8)
            text = text_of_line(line, self.name, self._read).rstrip("\r\n")
            self._kept.append((self._read, text))
            yield text

    def take(self, count: int) -> list[str]:
        """Return the next lines, not kept."""
        taken: list[str] = []
        lines = self.lines()
        while len(taken) < count:
            line = next(lines, None)
            if line is None:
                raise RequestRefused("MC511", f"{self.name} has only {len(taken)} lines", "see --from-line")
            taken.append(line)
        self._kept.clear()
        return taken

    def text_of(self, number: int) -> str | None:
        """Return a line that is kept."""
        if not self._kept:
            return None
        index = number - self._kept[0][0]
        return self._kept[index][1] if 0 <= index < len(self._kept) else None

    def line_at(self, number: int) -> str | None:
        """Return a line of the file, wherever reading stands; None: there is no such line, or it is no
        text.
        """
        if self.total is None or number < 1:
            return None
        with open(self.path, "rb") as file:
            line = next(islice(file, number - 1, None), None)
        if line is None:
            return None
        with contextlib.suppress(RequestRefused):
            line = line.removeprefix(BOM_UTF8) if number == 1 else line
            return text_of_line(line, self.name, number).rstrip("\r\n")
        return None

    def forget(self, through: int) -> None:
        """Lines through this number are not needed any more."""
        while self._kept and self._kept[0][0] <= through:
            self._kept.popleft()

    def close(self) -> None:
        if not self.is_stdin:
            self._stream.close()


def _count_lines(stream: BinaryIO) -> int:
    count, last = 0, b"\n"
    while block := stream.read(COUNT_BYTES):
        count += block.count(b"\n")
        last = block[-1:]
    stream.seek(0)
    return count + (last != b"\n")
