"""The one queue of a program's text: from the journal to the interpreter."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import islice

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.text.source import MAX_LINE_LENGTH


class LineBuffer:
    """Holds numbered lines until the interpreter reads them.

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
        self._lines: deque[tuple[int, str]] = deque()
        # lines that are no lines, by number; in order, as they came
        self._unfit: deque[tuple[int, Diagnostic]] = deque()
        self._steps = 0

    def __len__(self) -> int:
        return len(self._lines)

    @property
    def ready(self) -> int:
        """Count the lines that may be taken now."""
        return min(len(self._lines), self._steps) if self.single_line else len(self._lines)

    def put(self, first: int, lines: Sequence[str]) -> None:
        """Append lines ``first``, ``first + 1``, …; nothing once it is closed."""
        if self.closed:
            return
        for number, text in enumerate(lines, first):
            if len(text) > MAX_LINE_LENGTH or "\n" in text or "\r" in text:
                self._unfit.append((number, _diagnose(number, text)))
            self._lines.append((number, text))

    def step(self) -> None:
        """Release one more line in single-line mode."""
        self._steps += 1

    def run(self, most: int) -> list[str]:
        """Copy up to ``most`` lines from the front, as far as their numbers have no gap."""
        count = min(most, self.ready)
        if not count:
            return []
        first = self._lines[0][0]
        if self._unfit:
            count = min(count, self._unfit[0][0] - first)
        found = list(islice(self._lines, count))
        if found and found[-1][0] - first != len(found) - 1:
            return []
        return [text for _, text in found]

    @property
    def next_number(self) -> int:
        """Number of the line at the front."""
        return self._lines[0][0]

    def take(self) -> tuple[int, str]:
        """Take the line at the front; there must be a `ready` one.

        Raises:
            ProgramRejected: MC513 it is too long or holds a line end.
        """
        number, text = self._lines.popleft()
        self._note(number, 1)
        if self._unfit and self._unfit[0][0] == number:
            raise ProgramRejected([self._unfit.popleft()[1]])
        return number, text

    def drop(self, count: int) -> None:
        """Take ``count`` lines, which `run` has shown."""
        number = 0
        for _ in range(count):
            number, _ = self._lines.popleft()
        self._note(number, count)

    def clear(self) -> None:
        """Forget what waits: a line before it was faulty, or the program has ended."""
        self._lines.clear()
        self._unfit.clear()

    def _note(self, number: int, count: int) -> None:
        self.consumed = number
        if self.single_line:
            self._steps -= count


def _diagnose(line: int, text: str) -> Diagnostic:
    if len(text) > MAX_LINE_LENGTH:
        message = f"the line has {len(text)} characters, more than {MAX_LINE_LENGTH}"
    else:
        message = "the line holds a line end"
    return Diagnostic(code="MC513", message=message, line=line, hint="send one line an item")
