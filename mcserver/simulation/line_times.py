"""What a simulation knows of each line that took time, in columns: some 40 bytes a line."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.planning.line_marks import MOST_PAUSES, LineMarks, MarkFitter

# Lines of one block of columns.
BLOCK = 4096


class _Block:
    """Columns of some lines that follow each other; times in seconds, NaN where there is none."""

    def __init__(self) -> None:
        nothing = [math.nan] * BLOCK
        self.start = array("d", nothing)
        self.end = array("d", nothing)
        self.requested = array("d", nothing)
        self.planning = array("d", bytes(8 * BLOCK))
        # motions of the line that have begun, and those that ask for a time
        self.begun = array("i", bytes(4 * BLOCK))
        self.timed = array("i", bytes(4 * BLOCK))
        # index of the limit's name, 0: none
        self.bound = array("i", bytes(4 * BLOCK))


class LineTimes:
    """Times of lines, noted in any order.

    Args:
        keep: keep every line; False: only marks remain of lines that are long over.
        planning: lines have ``planning_s`` too.
    """

    def __init__(self, *, keep: bool = True, planning: bool = False) -> None:
        self._keep = keep
        self._planning = planning
        self._blocks: dict[int, _Block] = {}
        self._bounds: list[str | None] = [None]
        self._bound_index: dict[str, int] = {}
        self._fitter = MarkFitter()
        self._fitted = 0
        self._reached_s = 0.0
        self._pauses: list[int] = []

    def _at(self, line: int) -> tuple[_Block, int]:
        number, row = divmod(line, BLOCK)
        block = self._blocks.get(number)
        if block is None:
            block = self._blocks[number] = _Block()
        return block, row

    # ------------------------------------------------------------ notes

    def asked(self, line: int, requested_s: float) -> None:
        """Add up the times that a line's motions ask for; a canned cycle has several."""
        block, row = self._at(line)
        before = block.requested[row]
        block.requested[row] = requested_s + (0.0 if math.isnan(before) else before)
        block.timed[row] += 1

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

    def paused(self, line: int) -> None:
        """Note that a line waits for an operator."""
        if len(self._pauses) < MOST_PAUSES:
            self._pauses.append(line)

    # ------------------------------------------------------------ marks

    def marks(self) -> LineMarks:
        """Return when those lines end that are over for certain; more may come."""
        return self._fitter.marks(pauses=tuple(self._pauses))

    def all_marks(self, duration_s: float, last: int) -> LineMarks:
        """Return when all lines of a program end: it lasts ``duration_s`` and has ``last`` lines."""
        self._fit(last + 1)
        return self._fitter.marks(duration_s, tuple(self._pauses))

    def _fit(self, before: int) -> None:
        """Hand the lines before this one to the marks; whole blocks, unless all lines are kept."""
        for line in range(self._fitted + 1, before):
            block = self._blocks.get(line // BLOCK)
            end = math.nan if block is None else block.end[line % BLOCK]
            if end > self._reached_s:
                self._reached_s = end
            self._fitter.add(line, self._reached_s)
            self._fitted = line
            if not self._keep and line % BLOCK == BLOCK - 1:
                self._blocks.pop(line // BLOCK, None)

    # ------------------------------------------------------------ lines

    def __len__(self) -> int:
        return sum(int(np.count_nonzero(_timed(block))) for block in self._blocks.values())

    def rows(self) -> Iterator[dict[str, Any]]:
        """Return the lines that took time, by start and number, as the report's ``lines``."""
        numbers, starts = [], []
        for number, block in sorted(self._blocks.items()):
            timed = np.flatnonzero(_timed(block))
            numbers.append(number * BLOCK + timed)
            starts.append(np.frombuffer(block.start)[timed])
        if not numbers:
            return
        lines = np.concatenate(numbers)
        for line in lines[np.lexsort((lines, np.concatenate(starts)))]:
            yield self._row(int(line))

    def most_stretched(self, most: int) -> list[dict[str, Any]]:
        """Return up to ``most`` lines whose time is the longest against what was asked, by start."""
        found: list[tuple[float, int]] = []
        for number, block in sorted(self._blocks.items()):
            factor = _stretched(block)
            timed = np.flatnonzero(_timed(block))
            best = timed[np.argsort(-factor[timed], kind="stable")[:most]]
            found += [(-float(factor[row]), number * BLOCK + int(row)) for row in best]
            found = sorted(found)[:most]
        return sorted((self._row(line) for _, line in found), key=lambda row: (row["start_s"], row["line"]))

    def stretched_count(self) -> int:
        """Count the lines that a limit stretched."""
        return sum(
            int(
                np.count_nonzero(
                    _timed(block) & (_stretched(block) > 1.0 + 1e-9) & _int(block.bound).astype(bool)
                )
            )
            for block in self._blocks.values()
        )

    def _row(self, line: int) -> dict[str, Any]:
        block, row = self._at(line)
        start, end, requested = block.start[row], block.end[row], block.requested[row]
        asked = requested if block.timed[row] >= block.begun[row] and not math.isnan(requested) else None
        found = {
            "line": line,
            "start_s": start,
            "end_s": end,
            "requested_s": asked,
            "stretched_by": (end - start) / asked if asked else None,
            "bound_by": self._bounds[block.bound[row]],
        }
        if self._planning:
            found["planning_s"] = block.planning[row]
        return found


def _int(column: array[int]) -> NDArray[np.int32]:
    return np.frombuffer(column, dtype=np.int32)


def _timed(block: _Block) -> NDArray[np.bool_]:
    """Which lines took time."""
    timed: NDArray[np.bool_] = np.frombuffer(block.end) > np.frombuffer(block.start)
    return timed


def _stretched(block: _Block) -> NDArray[np.float64]:
    """Actual time by requested time; 0 where nothing was asked."""
    start, end, asked = (np.frombuffer(each) for each in (block.start, block.end, block.requested))
    known = (asked > 0.0) & (_int(block.timed) >= _int(block.begun))
    return np.divide(end - start, asked, out=np.zeros(BLOCK), where=known)
