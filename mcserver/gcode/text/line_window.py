"""Read a program's lines block by block, in memory that does not grow with the program."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

from mcserver.errors import ProgramRejected
from mcserver.gcode.text.source import find_odd_line

# Lines that are read ahead at once: enough that batches of similar lines are found whole.
BLOCK = 8192


class LineWindow:
    """The next lines of a program.

    Attributes:
        first: the first block of lines at most; for what a text begins with.
    """

    def __init__(self, lines: Iterable[str]) -> None:
        self._lines = iter(lines)
        self._ahead: list[str] = []
        # lines taken: of the block, and before it
        self._taken = 0
        self._before = 0
        self._read_on()
        self.first = self._ahead

    @property
    def done(self) -> int:
        """Return how many lines have been taken."""
        return self._before + self._taken

    @property
    def ended(self) -> bool:
        """Whether all lines have been taken."""
        if self._taken == len(self._ahead):
            self._read_on()
        return not self._ahead

    def peek(self, most: int) -> list[str]:
        """Return up to ``most`` next lines; fewer only at the end of the program."""
        if len(self._ahead) - self._taken < most:
            self._read_on()
        return self._ahead[self._taken : self._taken + most]

    def drop(self, count: int) -> None:
        """Take ``count`` lines that `peek` has returned."""
        self._taken += count

    def _read_on(self) -> None:
        """Read another block.

        Raises:
            ProgramRejected: MC156 a line that no machine accepts; what the lines' source raises.
        """
        kept = self._ahead[self._taken :]
        self._before += self._taken
        self._taken = 0
        more = list(islice(self._lines, BLOCK))
        odd = find_odd_line(more, self._before + len(kept) + 1)
        if odd is not None:
            raise ProgramRejected([odd])
        self._ahead = kept + more
