"""When the lines of a program end, in so many straight stretches, whatever the program's length."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import msgspec

# Marks of one program, and pauses whose lines are kept.
MOST_MARKS = 4096
MOST_PAUSES = 1000
# How far the marks may be from the truth at first [s]; doubled when there are too many of them.
FIRST_TOLERANCE_S = 1e-3
# between times that are one but for rounding [s]
_SAME_S = 1e-9


class LineMarks(msgspec.Struct, frozen=True):
    """Times of a program's lines at 100 %; between two marks each line takes the same time.

    Attributes:
        lines, ends: marks: a line and when it ends [s]; both rise, the first mark is line 0 at 0.
        duration_s: of the program, as far as it is known [s].
        through: the last line that is known. complete: nothing comes behind it.
        pauses: lines that wait for an operator, such as M0; their waiting is no part of the times.
        within_s: the marks are this close to the truth [s].
        dwell_lines, dwells: marks as well: a line, and for how long those through it dwell [s].
    """

    lines: list[int]
    ends: list[float]
    duration_s: float
    through: int
    complete: bool = True
    pauses: tuple[int, ...] = ()
    within_s: float = 0.0
    dwell_lines: tuple[int, ...] = (0,)
    dwells: tuple[float, ...] = (0.0,)

    def end_of(self, line: int) -> float:
        """Return when all lines through this one have ended [s]."""
        return _between(self.lines, self.ends, line)

    def dwell_of(self, line: int) -> float:
        """Return for how long all lines through this one dwell [s]."""
        return _between(self.dwell_lines, self.dwells, line)

    def next_line(self, line: int) -> int | None:
        """Return the first line behind this one that takes time; None behind all."""
        reached = self.end_of(line)
        for at in range(max(1, bisect_right(self.lines, line)), len(self.lines)):
            if self.ends[at] > reached + _SAME_S:
                return max(line, self.lines[at - 1]) + 1
        return None

    def next_end(self, line: int) -> float:
        """Return when the first line behind this one that takes time ends [s]; the duration behind all."""
        following = self.next_line(line)
        return self.duration_s if following is None else max(self.end_of(following), self.end_of(line))

    def stretched_to(self, total: int) -> LineMarks:
        """Return these marks with further lines, up to ``total``, as quick as those before on average.

        Complete ones are returned as they are.
        """
        if self.complete or total <= self.through or not self.through:
            return self
        longer = total / self.through
        end = self.duration_s * longer
        return msgspec.structs.replace(
            self,
            lines=[*self.lines, total],
            ends=[*self.ends, end],
            duration_s=end,
            dwell_lines=(*self.dwell_lines, total),
            dwells=(*self.dwells, self.dwells[-1] * longer),
        )


def _between(lines: Sequence[int], values: Sequence[float], line: int) -> float:
    """Return the value at a line between marks; that of the last mark behind it."""
    at = bisect_right(lines, line) - 1
    if at < 0:
        return 0.0
    if at + 1 == len(lines):
        return values[-1]
    share = (line - lines[at]) / (lines[at + 1] - lines[at])
    return values[at] + share * (values[at + 1] - values[at])


class MarkFitter:
    """Makes marks from the ends of lines as they come, in one pass.

    From each mark a stretch goes on as long as the straight line to its newest point passes all points
    between within the tolerance.

    Args:
        most: so many marks at most.
    """

    def __init__(self, most: int = MOST_MARKS) -> None:
        self._most = most
        self._tolerance = FIRST_TOLERANCE_S
        self._thinned = False
        self._restart()

    def _restart(self) -> None:
        self._lines, self._ends = [0], [0.0]
        self._newest = 0, 0.0
        self._low, self._high = float("-inf"), float("inf")

    def add(self, line: int, end_s: float) -> None:
        """Take the next line and its end [s]; neither is before the one before."""
        anchor, since = self._lines[-1], self._ends[-1]
        lines = line - anchor
        if lines <= 0:
            return
        slope = (end_s - since) / lines
        if not self._low <= slope <= self._high:
            # the newest point ends its stretch
            anchor, since = self._newest
            self._lines.append(anchor)
            self._ends.append(since)
            self._low, self._high = float("-inf"), float("inf")
            lines = line - anchor
        self._low = max(self._low, (end_s - self._tolerance - since) / lines)
        self._high = min(self._high, (end_s + self._tolerance - since) / lines)
        self._newest = line, end_s
        if len(self._lines) >= self._most:
            self._thin()

    def marks(self, duration_s: float | None = None, pauses: tuple[int, ...] = ()) -> LineMarks:
        """Return what has been taken so far.

        Args:
            duration_s: of the whole program, which is complete [s]; None: more lines may come.
        """
        line, end = self._newest
        ends_there = self._lines[-1] == line
        return LineMarks(
            lines=list(self._lines) if ends_there else [*self._lines, line],
            ends=list(self._ends) if ends_there else [*self._ends, end],
            duration_s=end if duration_s is None else duration_s,
            through=line,
            complete=duration_s is not None,
            pauses=pauses,
            # each doubling fits the marks of the one before
            within_s=self._tolerance * (2.0 if self._thinned else 1.0),
        )

    def _thin(self) -> None:
        while len(self._lines) > self._most // 2:
            # the newest point ends at a mark or lies behind the last one, with nothing between
            points = [*zip(self._lines[1:], self._ends[1:], strict=True), self._newest]
            self._thinned = True
            self._tolerance *= 2.0
            self._restart()
            for line, end in points:
                self.add(line, end)
