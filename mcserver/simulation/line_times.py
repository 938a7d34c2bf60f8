"""What a simulation knows of each line that took time, in columns: some 40 bytes a line."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.planning.line_marks import MOST_PAUSES, LineMarks, MarkFitter

# Lines of one block of columns.
BLOCK = 4096


class _Columns(NamedTuple):
    """Columns of some lines that follow each other; times in seconds, NaN where not known.

    Attributes:
        begun, timed: motions of the line that have begun, and those that ask for a time.
        bound: index of the limit's name, 0: none.
    """

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    requested: NDArray[np.float64]
    planning: NDArray[np.float64]
    begun: NDArray[np.int32]
    timed: NDArray[np.int32]
    bound: NDArray[np.int32]

    @classmethod
    def of(cls, count: int) -> _Columns:
        """Return columns of lines of which nothing is known."""
        start, end, requested = np.full((3, count), math.nan)
        begun, timed, bound = np.zeros((3, count), np.int32)
        return cls(start, end, requested, np.zeros(count), begun, timed, bound)

    @property
    def took_time(self) -> NDArray[np.bool_]:
        """Which lines took time."""
        timed: NDArray[np.bool_] = self.end > self.start
        return timed

    @property
    def known(self) -> NDArray[np.bool_]:
        """Of which lines it is known what time they ask for."""
        known: NDArray[np.bool_] = (self.timed >= self.begun) & ~np.isnan(self.requested)
        return known

    @property
    def stretched(self) -> NDArray[np.float64]:
        """Actual time by requested time; 0 where nothing was asked."""
        asked = self.known & (self.requested > 0.0)
        stretched: NDArray[np.float64] = np.divide(
            self.end - self.start, self.requested, out=np.zeros(len(asked)), where=asked
        )
        return stretched


class LineTimes:
    """Times of lines, noted in any order.

    Args:
        keep: keep every line; False: only marks remain of lines that are long over.
        planning: lines have ``planning_s`` too.
    """

    def __init__(self, *, keep: bool = True, planning: bool = False) -> None:
        self._keep = keep
        self._planning = planning
        self._blocks: dict[int, _Columns] = {}
        self._bounds: list[str | None] = [None]
        self._bound_index: dict[str, int] = {}
        self._fitter, self._dwell_fitter = MarkFitter(), MarkFitter()
        # of lines that are not fitted yet
        self._dwells: dict[int, float] = {}
        self._dwelt_s = 0.0
        self._fitted = 0
        self._reached_s = 0.0
        self._pauses: list[int] = []

    def _at(self, line: int) -> tuple[_Columns, int]:
        number, row = divmod(line, BLOCK)
        block = self._blocks.get(number)
        if block is None:
            block = self._blocks[number] = _Columns.of(BLOCK)
        return block, row

    # ------------------------------------------------------------ notes

    def asked(self, line: int, requested_s: float) -> None:
        """Add up the times that a line's motions ask for; a canned cycle has several."""
        block, row = self._at(line)
        before = block.requested[row]
        block.requested[row] = requested_s + (0.0 if np.isnan(before) else before)
        block.timed[row] += 1

    def asked_in_columns(self, lines: NDArray[np.int64], requested_s: NDArray[np.float64]) -> None:
        """Add up the times that lines ask for, as `asked` does one by one; each of them comes once."""
        for columns, rows, part in self._parts(lines):
            before = columns.requested[rows]
            columns.requested[rows] = requested_s[part] + np.where(np.isnan(before), 0.0, before)
            columns.timed[rows] += 1

    def dwelt(self, line: int, seconds: float) -> None:
        """Add up for how long a line dwells, whatever the override."""
        self._dwells[line] = self._dwells.get(line, 0.0) + seconds

    def bound(self, line: int, by: str | None) -> None:
        """Note which limit stretched a line."""
        block, row = self._at(line)
        if by is None:
            block.bound[row] = 0
            return
        index = self._bound_index.get(by)
        if index is None:
            index = self._bound_index[by] = len(self._bounds)
            self._bounds.append(by)
        block.bound[row] = index

    def solved(self, line: int, planning_s: float) -> None:
        """Note how long the inverse kinematics of a line took."""
        block, row = self._at(line)
        block.planning[row] = planning_s

    def started(self, line: int, at_s: float) -> None:
        """Note that a motion of a line begins: the line starts with the first of them."""
        block, row = self._at(line)
        if block.begun[row] == 0:
            block.start[row] = at_s
        block.begun[row] += 1

    def ended(self, line: int, at_s: float) -> None:
        """Note that a line has ended."""
        block, row = self._at(line)
        block.end[row] = at_s
        # whole blocks that lie a block behind: nothing of them comes any more
        if not self._keep and line - self._fitted >= 3 * BLOCK:
            self._fit(line - 2 * BLOCK)

    def passed(self, lines: NDArray[np.int64], at_s: NDArray[np.float64], ends: NDArray[np.bool_]) -> None:
        """Note where lines begin and end, as `started` and `ended` do one by one.

        Args:
            lines, at_s: in order of time, shape (n,). ends: which of them end.
        """
        for columns, rows, part in self._parts(lines):
            begin, moments = ~ends[part], at_s[part]
            opened, since = rows[begin], moments[begin]
            fresh = columns.begun[opened] == 0
            # of several beginnings the first, which is written last; of several ends the last
            columns.start[opened[fresh][::-1]] = since[fresh][::-1]
            np.add.at(columns.begun, opened, 1)
            columns.end[rows[~begin]] = moments[~begin]
        ended = lines[ends]
        if not self._keep and len(ended) and int(ended[-1]) - self._fitted >= 3 * BLOCK:
            self._fit(int(ended[-1]) - 2 * BLOCK)

    def _parts(
        self, lines: NDArray[np.int64]
    ) -> Iterator[tuple[_Columns, NDArray[np.int64], NDArray[np.intp]]]:
        """Yield for each block of lines its columns, the rows of lines there, and their places in
        ``lines``.
        """
        numbers = lines // BLOCK
        for number in np.unique(numbers).tolist():
            part = np.flatnonzero(numbers == number)
            block, _ = self._at(number * BLOCK)
            yield block, lines[part] - number * BLOCK, part

    def paused(self, line: int) -> None:
        """Note that a line waits for an operator."""
        if len(self._pauses) < MOST_PAUSES:
            self._pauses.append(line)

    # ------------------------------------------------------------ marks

    def marks(self) -> LineMarks:
        """Return when those lines end that are over for certain; more may come."""
        return self._with_dwells(self._fitter.marks(pauses=tuple(self._pauses)))

    def all_marks(self, duration_s: float, last: int) -> LineMarks:
        """Return when all lines of a program end: it lasts ``duration_s`` and has ``last`` lines."""
        self._fit(last + 1)
        return self._with_dwells(self._fitter.marks(duration_s, tuple(self._pauses)))

    def _with_dwells(self, marks: LineMarks) -> LineMarks:
        dwells = self._dwell_fitter.marks()
        return msgspec.structs.replace(marks, dwell_lines=tuple(dwells.lines), dwells=tuple(dwells.ends))

    def _fit(self, before: int) -> None:
        """Hand the lines before this one to the marks; whole blocks, unless all lines are kept."""
        for line in range(self._fitted + 1, before):
            block = self._blocks.get(line // BLOCK)
            end = math.nan if block is None else float(block.end[line % BLOCK])
            if end > self._reached_s:
                self._reached_s = end
            self._fitter.add(line, self._reached_s)
            self._dwelt_s += self._dwells.pop(line, 0.0)
            self._dwell_fitter.add(line, self._dwelt_s)
            self._fitted = line
            if not self._keep and line % BLOCK == BLOCK - 1:
                self._blocks.pop(line // BLOCK, None)

    # ------------------------------------------------------------ lines

    def __len__(self) -> int:
        return sum(int(np.count_nonzero(block.took_time)) for block in self._blocks.values())

    def rows(self) -> Iterator[dict[str, Any]]:
        """Return the lines that took time, by start and number, as the report's ``lines``."""
        numbers, starts = [], []
        for number, block in sorted(self._blocks.items()):
            timed = np.flatnonzero(block.took_time)
            numbers.append(number * BLOCK + timed)
            starts.append(block.start[timed])
        if not numbers:
            return
        lines = np.concatenate(numbers)
        lines = lines[np.lexsort((lines, np.concatenate(starts)))]
        for first in range(0, len(lines), BLOCK):
            yield from self._rows(lines[first : first + BLOCK])

    def most_stretched(self, most: int) -> list[dict[str, Any]]:
        """Return up to ``most`` lines whose time is the longest against what was asked, by start."""
        found: list[tuple[float, int]] = []
        for number, block in sorted(self._blocks.items()):
            factor = block.stretched
            timed = np.flatnonzero(block.took_time)
            best = timed[np.argsort(-factor[timed], kind="stable")[:most]]
            found += [(-float(factor[row]), number * BLOCK + int(row)) for row in best]
            found = sorted(found)[:most]
        rows = self._rows(np.array([line for _, line in found], np.int64))
        return sorted(rows, key=lambda row: (row["start_s"], row["line"]))

    def stretched_count(self) -> int:
        """Count the lines that a limit stretched."""
        count = 0
        for block in self._blocks.values():
            stretched = block.took_time & (block.stretched > 1.0 + 1e-9) & (block.bound != 0)
            count += int(np.count_nonzero(stretched))
        return count

    def _rows(self, lines: NDArray[np.int64]) -> list[dict[str, Any]]:
        """Return the rows of some lines, in their order."""
        found = _Columns.of(len(lines))
        for of_block, places, part in self._parts(lines):
            every: tuple[tuple[NDArray[Any], ...], ...] = (found, of_block)
            for own, column in zip(*every, strict=True):
                own[part] = column[places]
        lasts = found.end - found.start
        asked = found.requested.astype(object)
        asked[~found.known] = None
        factor = np.divide(lasts, found.requested, out=lasts, where=found.requested != 0.0).astype(object)
        factor[~found.known | (found.requested == 0.0)] = None
        rows = [
            {
                "line": line,
                "start_s": start,
                "end_s": end,
                "requested_s": requested,
                "stretched_by": stretched,
                "bound_by": self._bounds[bound],
            }
            for line, start, end, requested, stretched, bound in zip(
                lines.tolist(),
                found.start.tolist(),
                found.end.tolist(),
                asked.tolist(),
                factor.tolist(),
                found.bound.tolist(),
                strict=True,
            )
        ]
        if self._planning:
            for row, planning_s in zip(rows, found.planning.tolist(), strict=True):
                row["planning_s"] = planning_s
        return rows
