"""The one queue of a program's text: from the journal to the interpreter."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.text.source import MAX_LINE_LENGTH


class LineBuffer:
    """Hold numbered lines until the interpreter reads them.

    The service's credit bounds what is in it (`mcserver.service.line_queue`). In single-line mode each step
    releases one line.

    Attributes:
        closed: no more lines will come.
        consumed: number of the last line that was taken out, 0 before.
        single_line: hold lines back until each is released by `step`.
    """

    def __init__(self) -> None:
        self.closed = False
        self.consumed = 0
        self.single_line = False
        # blocks of lines: the number of the first, and the lines
        self._blocks: deque[tuple[int, list[str]]] = deque()
        # lines taken from the front block, and lines waiting in all
        self._taken = 0
        self._count = 0
        # lines that are too long or hold a line end, by number, in order
        self._unfit: deque[tuple[int, Diagnostic]] = deque()
        self._steps = 0

    def __len__(self) -> int:
        return self._count

    @property
    def ready(self) -> int:
        """Count the lines that may be taken now."""
        return min(self._count, self._steps) if self.single_line else self._count

    def put(self, first: int, lines: Sequence[str]) -> None:
        """Append lines ``first``, ``first + 1``, …; nothing once it is closed."""
        if self.closed or not lines:
            return
        block = list(lines)
        every = "".join(block)
        if max(map(len, block)) > MAX_LINE_LENGTH or "\n" in every or "\r" in every:
            self._unfit.extend(
                (number, _diagnose(number, text))
                for number, text in enumerate(block, first)
                if len(text) > MAX_LINE_LENGTH or "\n" in text or "\r" in text
            )
        self._blocks.append((first, block))
        self._count += len(block)

    def step(self) -> None:
        """Release one more line in single-line mode."""
        self._steps += 1

    def run(self, most: int) -> list[str]:
        """Copy up to ``most`` lines from the front, as far as their numbers have no gap."""
        count = min(most, self.ready)
        if not count:
            return []
        front = self.next_number
        if self._unfit:
            count = min(count, self._unfit[0][0] - front)
        found: list[str] = []
        at = self._taken
        for first, lines in self._blocks:
            if len(found) >= count or first + at != front + len(found):
                break
            found += lines[at : at + count - len(found)]
            at = 0
        return found

    @property
    def next_number(self) -> int:
        """Number of the line at the front."""
        return self._blocks[0][0] + self._taken

    def take(self) -> tuple[int, str]:
        """Take the line at the front; there must be a `ready` one.

        Raises:
            ProgramRejected: MC513 it is too long or holds a line end.
        """
        number, text = self.next_number, self._blocks[0][1][self._taken]
        self.drop(1)
        if self._unfit and self._unfit[0][0] == number:
            raise ProgramRejected([self._unfit.popleft()[1]])
        return number, text

    def drop(self, count: int) -> None:
        """Take ``count`` lines that `run` has returned."""
        left = count
        while left > 0:
            first, lines = self._blocks[0]
            part = min(left, len(lines) - self._taken)
            self._taken += part
            left -= part
            self.consumed = first + self._taken - 1
            if self._taken == len(lines):
                self._blocks.popleft()
                self._taken = 0
        self._count -= count
        if self.single_line:
            self._steps -= count

    def clear(self) -> None:
        """Drop all waiting lines: a line before them was faulty, or the program has ended."""
        self._blocks.clear()
        self._taken = self._count = 0
        self._unfit.clear()


def _diagnose(line: int, text: str) -> Diagnostic:
    if len(text) > MAX_LINE_LENGTH:
        message = f"the line has {len(text)} characters, more than {MAX_LINE_LENGTH}"
    else:
        message = "the line holds a line end"
    return Diagnostic(code="MC513", message=message, line=line, hint="send one line an item")
