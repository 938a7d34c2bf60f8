"""The segments of a run with what is known of each alone, in columns: a plan looks at thousands of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import Segment, StraightRun
from mcserver.motion.kernels.groups import (
    AFTER,
    BEFORE,
    CAP,
    COLUMN,
    DURATION,
    END,
    EXTENT,
    FEED,
    KEY,
    KIND,
    MARKS,
    NUMBERS,
    REQUESTED,
    SPEED,
    TOLERANCE,
    TOP,
    Columns,
)
from mcserver.motion.kernels.polynomials import KINDS
from mcserver.motion.lookahead.growable_array import Growing
from mcserver.motion.lookahead.path_limits import SpeedLimit


@dataclass(frozen=True)
class NodesMark:
    """How nodes stood, to go back to; ``last`` is what may change of the last one."""

    count: int
    segment: Segment
    last: tuple[float, int]


class Nodes:
    """Segments on end.

    Attributes:
        segments: the segments, n of them.

    Args:
        width: columns of the machine.
    """

    def __init__(self, width: int) -> None:
        self.segments: list[Segment] = []
        self._numbers: Growing[np.float64] = Growing(NUMBERS, np.dtype(np.float64))
        self._marks: Growing[np.intp] = Growing(MARKS, np.dtype(np.intp))
        self._rows: Growing[np.float64] = Growing(5 * width + 2, np.dtype(np.float64))
        self._dropped = 0
        self._gone = 0.0

    def __len__(self) -> int:
        return len(self.segments)

    @property
    def numbers(self) -> Array:
        """Shape (n, `NUMBERS`)."""
        return self._numbers.rows

    @property
    def marks(self) -> NDArray[np.intp]:
        """Shape (n, `MARKS`)."""
        return self._marks.rows

    @property
    def rows(self) -> Array:
        """Samples of all segments, rows of `mcserver.motion.kernels.sample_limits`, as `Columns` has them."""
        return self._rows.rows

    @property
    def columns(self) -> Columns:
        """All this for kernels."""
        return Columns(self.numbers, self.marks, self.rows, self._dropped, self._gone)

    def columns_with_stops(self, at: NDArray[np.bool_]) -> Columns:
        """The same with stops at the starts of some segments, shape (n,): a vertex there asks for nothing."""
        columns = self.columns
        numbers, rows = columns.numbers.copy(), columns.rows.copy()
        (behind,) = np.nonzero(at)
        ends = columns.marks[:, END] - columns.dropped
        vertices = np.concatenate((ends[behind - 1] - 1, ends[behind] - 1 - columns.marks[behind, AFTER]))
        width = (rows.shape[1] - 2) // 5
        numbers[behind, CAP] = 0.0
        rows[vertices, 3 * width : 5 * width] = 0.0
        rows[vertices, -1] = np.inf
        return columns._replace(numbers=numbers, rows=rows)

    @property
    def timed(self) -> NDArray[np.bool_]:
        """Which segments have a T of their own, shape (n,)."""
        return ~np.isnan(self.numbers[:, DURATION])

    def rows_of(self, index: int) -> Array:
        """Samples of one segment, those of vertices too."""
        ends = self.marks[:, END]
        low = self._dropped if index == 0 else int(ends[index - 1])
        return self.rows[low - self._dropped : int(ends[index]) - self._dropped]

    def limit_of(self, index: int) -> SpeedLimit:
        """What the axes allow on one segment."""
        column, kind = self.marks[index, [COLUMN, KIND]].tolist()
        return SpeedLimit(float(self.numbers[index, SPEED]), column, KINDS[kind])

    # ------------------------------------------------------------------ growing and shrinking

    def append(
        self, segment: Segment, cap: float, limit: SpeedLimit, samples: Array, vertex: Array | None
    ) -> None:
        """Adds a segment.

        Args:
            cap: greatest speed at its start. limit: by the axes. samples: of it alone, (m, 5 K + 2).
            vertex: samples of the vertex at its start, of the segment before and of this one,
                shape (2, 5 K + 2); None: there is none.
        """
        if vertex is not None:
            self._rows.add(vertex[:1])
            self.marks[-1, [END, AFTER]] += 1
        self._rows.add(samples)
        if vertex is not None:
            self._rows.add(vertex[1:])
        feed = segment.feed * segment.scale
        numbers = np.empty((1, NUMBERS))
        numbers[0, [EXTENT, CAP, TOP]] = segment.extent, cap, min(limit.velocity, feed)
        numbers[0, [SPEED, FEED, REQUESTED]] = limit.velocity, feed, segment.requested
        numbers[0, DURATION] = np.nan if segment.duration is None else segment.duration
        numbers[0, TOLERANCE] = segment.tolerance
        marks = np.zeros((1, MARKS), np.intp)
        marks[0, [COLUMN, KIND]] = limit.column, KINDS.index(limit.kind)
        marks[0, [END, BEFORE]] = self._dropped + len(self.rows), vertex is not None
        self._numbers.add(numbers)
        self._marks.add(marks)
        self.segments.append(segment)

    def append_run(
        self,
        run: StraightRun,
        active: int,
        numbers: Array,
        marks: NDArray[np.intp],
        rows: Array,
        *,
        leads: bool,
    ) -> None:
        """Adds straight segments on end.

        Args:
            numbers, marks: of them, where `END` counts from the first of ``rows``. rows: their samples.
            leads: the first of ``rows`` is that of the vertex at the end of the last segment so far.
        """
        if leads:
            self.marks[-1, [END, AFTER]] += 1
        marks[:, END] += self._dropped + len(self.rows)
        numbers[:, TOLERANCE] = 0.0
        self._rows.add(rows)
        self.segments.extend(run.segments(numbers[:, EXTENT].tolist(), active))
        self._numbers.add(numbers)
        self._marks.add(marks)

    def replace(self, index: int, segment: Segment) -> None:
        """Puts a trimmed segment in the place of a whole one."""
        if index == 0:
            self._gone += (segment.begin - self.segments[0].begin) * segment.scale
        self.segments[index] = segment
        self.numbers[index, EXTENT] = segment.extent

    def drop(self, count: int) -> None:
        """Forgets the first segments."""
        if count == 0:
            return
        samples = int(self.marks[count - 1, END]) - self._dropped
        self._dropped += samples
        self._gone = 0.0
        self._rows.drop(samples)
        self._numbers.drop(count)
        self._marks.drop(count)
        self.segments = self.segments[count:]

    def mark(self) -> NodesMark:
        """How it stands now; there is at least one segment."""
        last = (float(self.numbers[-1, EXTENT]), int(self.marks[-1, AFTER]))
        return NodesMark(len(self), self.segments[-1], last)

    def go_back(self, mark: NodesMark) -> None:
        """Forgets what came after ``mark``, and what became of the segment that was the last one then."""
        self.segments = [*self.segments[: mark.count - 1], mark.segment]
        self._numbers.cut(mark.count)
        self._marks.cut(mark.count)
        extent, after = mark.last
        last = self.marks[-1]
        last[END] -= last[AFTER] - after
        last[AFTER] = after
        self.numbers[-1, EXTENT] = extent
        self._rows.cut(int(last[END]) - self._dropped)

    def bind(self, indices: NDArray[np.intp], bits: NDArray[np.intp]) -> None:
        """Notes that a plan had to bind these edges of these segments; the next one begins with that."""
        np.bitwise_or.at(self.marks[:, KEY], indices, bits)
