"""A list of consecutive segments, held partly as columns, whose objects are made on access."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple, overload

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.path_columns import PathColumns
from mcserver.motion.geometry.segment import Segment
from mcserver.motion.geometry.segment_rows import SegmentRows


class _Objects:
    """Segments held as objects."""

    __slots__ = ("segments",)

    def __init__(self, segments: list[Segment]) -> None:
        self.segments = segments

    def __len__(self) -> int:
        return len(self.segments)

    def segment(self, index: int) -> Segment:
        return self.segments[index]

    def columns(self, first: int, behind: int) -> PathColumns:
        return PathColumns.of(self.segments[first:behind])

    def feed_scales(self, first: int, behind: int) -> Array:
        return np.array([each.feed_scale for each in self.segments[first:behind]])

    def set_scales(self, first: int, scales: Array) -> None:
        for index, scale in enumerate(scales.tolist(), first):
            self.segments[index].scale = scale


class _Block(NamedTuple):
    """Segments ``first`` … ``behind`` - 1 of a source."""

    source: SegmentRows | _Objects
    first: int
    behind: int


class SegmentList(Sequence[Segment]):
    """Consecutive segments; copies and slices share data, but a change of one list leaves the others."""

    __slots__ = ("_blocks", "_starts")

    def __init__(self, segments: Iterable[Segment] = ()) -> None:
        self._blocks: list[_Block] = []
        # where each block begins, and where the last one ends
        self._starts = [0]
        given = list(segments)
        if given:
            self._put(_Block(_Objects(given), 0, len(given)))

    @classmethod
    def of(cls, source: SegmentRows) -> SegmentList:
        """Return all segments of a source."""
        found = cls()
        found._put(_Block(source, 0, len(source)))
        return found

    def _put(self, block: _Block) -> None:
        if block.behind > block.first:
            self._blocks.append(block)
            self._starts.append(self._starts[-1] + block.behind - block.first)

    def __len__(self) -> int:
        return self._starts[-1]

    @overload
    def __getitem__(self, index: int, /) -> Segment: ...
    @overload
    def __getitem__(self, index: slice, /) -> SegmentList: ...
    def __getitem__(self, index: int | slice, /) -> Segment | SegmentList:
        if isinstance(index, slice):
            first, behind, _ = index.indices(len(self))
            found = SegmentList()
            for block in self._between(first, behind):
                found._put(block)
            return found
        place = self._checked(index)
        at = bisect_right(self._starts, place) - 1
        block = self._blocks[at]
        return block.source.segment(block.first + place - self._starts[at])

    def __setitem__(self, index: int, segment: Segment) -> None:
        place = self._checked(index)
        at = bisect_right(self._starts, place) - 1
        source, first, behind = self._blocks[at]
        start, end = self._starts[at : at + 2]
        middle = first + place - start
        parts = (
            _Block(source, first, middle),
            _Block(_Objects([segment]), 0, 1),
            _Block(source, middle + 1, behind),
        )
        self._blocks[at : at + 1] = [part for part in parts if part.behind > part.first]
        self._starts[at + 1 : at + 1] = [each for each in (place, place + 1) if start < each < end]

    def __iter__(self) -> Iterator[Segment]:
        for source, first, behind in self._blocks:
            for index in range(first, behind):
                yield source.segment(index)

    def _checked(self, index: int) -> int:
        count = len(self)
        if not -count <= index < count:
            raise IndexError(index)
        return index % count

    def _between(self, first: int, behind: int) -> list[_Block]:
        """Return the blocks of segments ``first`` … ``behind`` - 1."""
        found: list[_Block] = []
        if behind <= first:
            return found
        at = bisect_right(self._starts, first) - 1
        while at < len(self._blocks) and self._starts[at] < behind:
            source, begin, end = self._blocks[at]
            start = self._starts[at]
            found.append(_Block(source, begin + max(first - start, 0), min(end, begin + behind - start)))
            at += 1
        return found

    # ------------------------------------------------------------------ growing and shrinking

    def copy(self) -> SegmentList:
        """Return a list that changes by itself."""
        return self[:]

    def append(self, segment: Segment) -> None:
        """Add a segment."""
        if self._blocks:
            source, first, behind = self._blocks[-1]
            if isinstance(source, _Objects) and behind == len(source.segments):
                # copies that share the source end before the new segment
                source.segments.append(segment)
                self._blocks[-1] = _Block(source, first, behind + 1)
                self._starts[-1] += 1
                return
        self._put(_Block(_Objects([segment]), 0, 1))

    def extend(self, segments: SegmentList | Iterable[Segment]) -> None:
        """Add segments."""
        if not isinstance(segments, SegmentList):
            segments = SegmentList(segments)
        for block in segments._blocks:
            self._put(block)

    def drop(self, count: int) -> None:
        """Remove the first segments."""
        self._keep(self._between(count, len(self)))

    def truncate(self, count: int) -> None:
        """Remove all but the first ``count`` segments."""
        self._keep(self._between(0, count))

    def _keep(self, blocks: list[_Block]) -> None:
        self._blocks, self._starts = [], [0]
        for block in blocks:
            self._put(block)

    # ------------------------------------------------------------------ columns

    def columns(self, first: int, behind: int) -> PathColumns:
        """Return the columns of segments ``first`` … ``behind`` - 1; the range must not be empty."""
        parts = [source.columns(low, high) for source, low, high in self._between(first, behind)]
        return PathColumns.joined(parts)

    def set_scales(self, scales: Array) -> None:
        """Set the scales of all segments, shape (n,)."""
        at = 0
        for source, first, behind in self._blocks:
            source.set_scales(first, scales[at : at + behind - first])
            at += behind - first

    def feed_scales(self) -> Array:
        """Return the feed scales of all segments, shape (n,)."""
        return np.concatenate([np.empty(0), *(source.feed_scales(*at) for source, *at in self._blocks)])
