"""Numbering and credit of one program's lines (docs/wire/lines.md).

Line n is accepted only if it is the next one. A repeat is acknowledged again and never executed again; a gap
is refused with the expected number. Credit bounds the waiting lines, in number and in bytes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import msgspec

QUEUE_LINES = 100_000
QUEUE_BYTES = 32 * 1024 * 1024


class LineBatch(msgspec.Struct, frozen=True):
    """Lines accepted into the queue, from ``first`` on; empty if all are repeats, or none fits."""

    first: int
    lines: Sequence[str]


class Gap(msgspec.Struct, frozen=True):
    """The message starts after the expected line; nothing was accepted."""

    expected: int


class LineQueue:
    """Counts the lines of one program from acceptance to the planner.

    Args:
        start_line: first number to accept.
        limit_lines, limit_bytes: bounds of what waits for the planner.
    """

    def __init__(
        self, start_line: int = 1, *, limit_lines: int = QUEUE_LINES, limit_bytes: int = QUEUE_BYTES
    ) -> None:
        self.accepted = start_line - 1
        self.consumed = start_line - 1
        self._limit_lines = limit_lines
        self._limit_bytes = limit_bytes
        self._waiting_bytes = 0
        # (last line, bytes) of each waiting message
        self._chunks: deque[tuple[int, int]] = deque()

    @property
    def expected(self) -> int:
        """Number of the next line."""
        return self.accepted + 1

    @property
    def credit(self) -> int:
        """Count of lines after ``accepted`` that fit now."""
        if self._waiting_bytes >= self._limit_bytes:
            return 0
        return max(0, self._limit_lines - (self.accepted - self.consumed))

    @property
    def limit(self) -> int:
        return self._limit_lines

    def take(self, first: int, lines: Sequence[str]) -> LineBatch | Gap:
        """Accept those of lines ``first``, ``first + 1``, … that are new and fit."""
        expected = self.accepted + 1
        if first > expected:
            return Gap(expected)
        if first < expected:
            lines = lines[expected - first :]
        credit = self.credit
        if len(lines) > credit:
            lines = lines[:credit]
        if not lines:
            return LineBatch(expected, ())
        # code points, a good enough measure of memory; the size of messages bounds each step
        size = sum(map(len, lines))
        self.accepted += len(lines)
        self._waiting_bytes += size
        self._chunks.append((self.accepted, size))
        return LineBatch(expected, lines)

    def consume(self, through: int) -> None:
        """Note that the planner has taken lines up to this number."""
        if through <= self.consumed:
            return
        self.consumed = through
        while self._chunks and self._chunks[0][0] <= through:
            self._waiting_bytes -= self._chunks.popleft()[1]

    def reject(self, line: int) -> None:
        """Expect the faulty line ``line`` again, and drop all waiting lines."""
        self.accepted = line - 1
        self.consumed = line - 1
        self._chunks.clear()
        self._waiting_bytes = 0
