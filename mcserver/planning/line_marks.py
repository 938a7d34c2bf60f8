"""End times of a program's lines, as a piecewise linear function of bounded size."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import msgspec

# Most marks of one program.
MOST_MARKS = 4096
# Most pauses whose lines are kept.
MOST_PAUSES = 1000
# Initial tolerance of the marks; doubled when there are too many marks [s].
FIRST_TOLERANCE_S = 1e-3
# times that differ by less are the same, but for rounding [s]
_SAME_S = 1e-9


class LineMarks(msgspec.Struct, frozen=True):
    """Times of a program's lines at 100 %; between two marks each line takes the same time.

    Attributes:
        lines, ends: marks: a line and when it ends [s]; both rise, the first mark is line 0 at 0.
        duration_s: of the program, as far as it is known [s].
        through: the last line that is known. complete: no line comes after it.
        pauses: lines that wait for an operator, such as M0; that wait is not part of the times.
        within_s: error bound of the marks [s].
        dwell_lines, dwells: marks of dwells: a line, and the total dwell through it [s].
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
        """Return the time at which all lines through this one have ended [s]."""
        return _between(self.lines, self.ends, line)

    def dwell_of(self, line: int) -> float:
        """Return the total dwell of all lines through this one [s]."""
        return _between(self.dwell_lines, self.dwells, line)

    def next_line(self, line: int) -> int | None:
        """Return the first line after this one that takes time; None without one."""
        reached = self.end_of(line)
        for at in range(max(1, bisect_right(self.lines, line)), len(self.lines)):
            if self.ends[at] > reached + _SAME_S:
                return max(line, self.lines[at - 1]) + 1
        return None

    def next_end(self, line: int) -> float:
        """Return the end of the first line after this one that takes time [s]; without one, the duration."""
        following = self.next_line(line)
        return self.duration_s if following is None else max(self.end_of(following), self.end_of(line))

    def stretched_to(self, total: int) -> LineMarks:
        """Return marks extended to line ``total`` at the average time per line; complete marks unchanged."""
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
    """Interpolate marks at a line; after the last mark, return its value."""
    at = bisect_right(lines, line) - 1
    if at < 0:
        return 0.0
    if at + 1 == len(lines):
        return values[-1]
    share = (line - lines[at]) / (lines[at + 1] - lines[at])
    return values[at] + share * (values[at + 1] - values[at])


class MarkFitter:
    """Fits marks to the ends of lines in one pass.

    A linear part goes on from its mark as long as the straight line to the newest point is within the
    tolerance of all points between.

    Args:
        most: greatest number of marks.
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
        """Add the next line and its end [s]; neither may decrease."""
        anchor, since = self._lines[-1], self._ends[-1]
        lines = line - anchor
        if lines <= 0:
            return
        slope = (end_s - since) / lines
        if not self._low <= slope <= self._high:
            # the newest point becomes a mark
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
        """Return the marks so far.

        Args:
            duration_s: of the complete program [s]; None: more lines may come.
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
            # each doubling fits the marks of the fit before, so errors add up to twice the tolerance
            within_s=self._tolerance * (2.0 if self._thinned else 1.0),
        )

    def _thin(self) -> None:
        while len(self._lines) > self._most // 2:
            # the newest point is a mark, or follows the last one directly
            points = [*zip(self._lines[1:], self._ends[1:], strict=True), self._newest]
            self._thinned = True
            self._tolerance *= 2.0
            self._restart()
            for line, end in points:
                self.add(line, end)
