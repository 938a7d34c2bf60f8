"""Numbering, credit and repetition of one program's lines: a state machine without I/O.

The client numbers lines. The server takes line n only if it is the next one; a repeat is acknowledged and
never executed again, a gap is refused. So whatever is not known to be accepted may be sent again at any time,
and must
be until it is: nothing is lost and nothing runs twice (docs/wire/lines.md).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import islice

# what waits for its acknowledgement at most: bounds memory, what a loss repeats, and how long a put can block
BUFFER_LINES = 16_384
BUFFER_BYTES = 512 * 1024
CHUNK_LINES = 1000
CHUNK_BYTES = 64 * 1024


@dataclass(frozen=True, slots=True)
class Chunk:
    """Lines ``first``, ``first + 1``, … to be sent."""

    first: int
    lines: list[str]


class LineWindow:
    """The lines between the last one accepted and the last one given.

    Args:
        first: number of the first line.
        credit: how many lines the server takes now.
    """

    def __init__(
        self,
        first: int,
        credit: int,
        *,
        buffer_lines: int = BUFFER_LINES,
        buffer_bytes: int = BUFFER_BYTES,
        chunk_lines: int = CHUNK_LINES,
        chunk_bytes: int = CHUNK_BYTES,
    ) -> None:
        self.accepted = first - 1
        self.credit = credit
        self._sent = first - 1
        # the last line that has ever gone out: it may arrive, even where it is to be sent again
        self._went_out = first - 1
        self._lines: deque[str] = deque()
        self._bytes = 0
        self._buffer_lines = buffer_lines
        self._buffer_bytes = buffer_bytes
        self._chunk_lines = chunk_lines
        self._chunk_bytes = chunk_bytes
        # the gap that has been answered by going back; its echoes, one for each message behind it, are not
        self._gap_answered = 0

    @property
    def given(self) -> int:
        """Number of the last line given."""
        return self.accepted + len(self._lines)

    @property
    def has_room(self) -> bool:
        """Whether another line may be given: always where none waits, so that a long line cannot stick."""
        return not self._lines or (len(self._lines) < self._buffer_lines and self._bytes < self._buffer_bytes)

    @property
    def pending(self) -> bool:
        """Whether lines have been given that are not known to be accepted."""
        return bool(self._lines)

    def give(self, line: str) -> int:
        """Appends a line and returns its number."""
        self._lines.append(line)
        self._bytes += len(line)
        return self.given

    def text(self, number: int) -> str | None:
        """Text of a line that waits."""
        index = number - self.accepted - 1
        return self._lines[index] if 0 <= index < len(self._lines) else None

    def next_chunk(self) -> Chunk | None:
        """Return what to send now, within the credit; it counts as sent."""
        first = self._sent + 1
        through = min(self.given, self.accepted + self.credit, self._sent + self._chunk_lines)
        if through < first:
            return None
        offset = first - self.accepted - 1
        lines = list(islice(self._lines, offset, offset + through - first + 1))
        size = 0
        for index, line in enumerate(lines):
            size += len(line)
            if size > self._chunk_bytes and index:
                del lines[index:]
                break
        self._sent += len(lines)
        self.goes_out(self._sent)
        return Chunk(first, lines)

    def goes_out(self, number: int) -> None:
        """Note that lines through this number are on their way."""
        self._went_out = max(self._went_out, number)

    def acknowledge(self, accepted: int, credit: int, *, expected: int = 0) -> None:
        """Takes a cumulative acknowledgement; one that is older than what is known changes nothing.

        Args:
            accepted: lines through this number are taken.
            credit: how many more fit.
            expected: a message left a gap; this line is expected. 0: no gap.
        """
        if accepted < self.accepted or accepted > self.given:
            return
        for _ in range(accepted - self.accepted):
            self._bytes -= len(self._lines.popleft())
        self.accepted = accepted
        self._sent = max(self._sent, accepted)
        self.credit = credit
        if expected == accepted + 1 and self._sent > accepted and self._gap_answered != expected:
            self._gap_answered = expected
            self._sent = accepted

    def rewind(self) -> None:
        """Everything that is not known to be accepted will be sent again."""
        self._sent = self.accepted

    def abandon(self) -> None:
        """Give up the lines that have never been sent; the others may be accepted."""
        while self.given > self._went_out and self._lines:
            self._bytes -= len(self._lines.pop())

    def reject(self, line: int) -> None:
        """Line ``line`` is faulty: it and what follows is given up, and ``line`` is the next number.

        A line that was accepted before may turn out faulty: acceptance steps back.
        """
        if line > self.given:
            return
        while self.given >= line and self._lines:
            self._bytes -= len(self._lines.pop())
        self.accepted = min(self.accepted, line - 1)
        self._sent = min(self._sent, self.given)
        self._went_out = min(self._went_out, self.given)
        self._gap_answered = 0
