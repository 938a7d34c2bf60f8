"""The segments of a run of lines, in columns."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import ArcCurve, Array
from mcserver.motion.geometry.made_segments import MadeSegments
from mcserver.motion.geometry.path_columns import ARC_KIND, STRAIGHT, PathColumns, bits_of
from mcserver.motion.geometry.run_feeds import RunFeeds
from mcserver.motion.geometry.segment import Segment


@dataclass(frozen=True, eq=False)
class RunSegments:
    """Straight segments and arcs on end, n of them, in a machine of K columns: a `SegmentSource`.

    Attributes:
        line, mask, active, scale: as of `Segment`, shape (n,). tolerance: the same for all.
        points: where each begins and the last one ends, shape (n+1, K).
        ends: dp/ds at the start and the end of each and d²p/ds² there, shape (n, 4, K).
        frame: shape (n,), which of the ``feed_columns`` each has.
        arcs: `Segment.arc` of all, shape (n, `ARC`), and which of them are arcs, shape (n,); None where all
            are straight. curve: makes the curve of an arc, and gives its columns.
    """

    line: NDArray[np.int64]
    mask: NDArray[np.uint64]
    active: NDArray[np.uint64]
    feeds: RunFeeds
    scale: Array
    points: Array
    ends: Array
    frame: NDArray[np.intp]
    feed_columns: tuple[NDArray[np.intp], ...]
    tolerance: float = 0.0
    arcs: tuple[Array, NDArray[np.bool_]] | None = None
    curve: Callable[[int], tuple[ArcCurve, NDArray[np.intp]]] | None = None
    _made: MadeSegments = field(default_factory=MadeSegments)

    def __len__(self) -> int:
        return len(self.line)

    def segment(self, index: int) -> Segment:
        """Return one of them, always the same object."""
        return self._made.get(index, self._segment)

    def _segment(self, index: int) -> Segment:
        ends = self.ends[index]
        curves: tuple[ArcCurve, ...] = ()
        columns: tuple[NDArray[np.intp], ...] = ()
        arc: Array | None = None
        if self.arcs is not None and self.curve is not None and self.arcs[1][index]:
            curve, of_curve = self.curve(index)
            curves, columns, arc = (curve,), (of_curve,), self.arcs[0][index]
        feeds = self.feeds
        duration = float(feeds.duration[index])
        return Segment(
            line=int(self.line[index]),
            curves=curves,
            columns=columns,
            mask=int(self.mask[index]),
            duration=None if math.isnan(duration) else duration,
            feed=float(feeds.feed[index]),
            requested=float(feeds.requested[index]),
            first=ends[0],
            last=ends[1],
            d2q_start=ends[2],
            d2q_end=ends[3],
            scale=float(self.scale[index]),
            base=self.points[index],
            end=self.points[index + 1],
            active=int(self.active[index]),
            straight=arc is None,
            feed_speed=float(feeds.feed_speed[index]),
            feed_columns=self.feed_columns[int(self.frame[index])],
            tolerance=self.tolerance,
            feed_scale=feeds.scale,
            arc=arc,
        )

    def columns(self, first: int, behind: int) -> PathColumns:
        """Return the columns of segments ``first`` … ``behind`` - 1."""
        at, count, feeds = slice(first, behind), behind - first, self.feeds
        whole = np.ones(count, np.bool_)
        spans = np.empty((count, 3))
        spans[:, 0], spans[:, 1], spans[:, 2] = self.scale[at], 0.0, 1.0
        kind = np.full(count, STRAIGHT, np.int8)
        arcs: Array | None = None
        if self.arcs is not None:
            rows, curved = self.arcs
            if curved[at].any():
                kind[curved[at]] = ARC_KIND
                arcs = rows[at]
        return PathColumns(
            self.line[at],
            self.active[at],
            whole,
            whole,
            np.full(count, feeds.scale),
            kind,
            spans,
            self.points[first:behind],
            np.ascontiguousarray(self.ends[at, 0]),
            self.points[first + 1 : behind + 1],
            self.mask[at],
            np.array([bits_of(each) for each in self.feed_columns], np.uint64)[self.frame[at]],
            feeds.duration[at],
            feeds.feed[at],
            feeds.requested[at],
            feeds.feed_speed[at],
            np.full(count, self.tolerance),
            arcs,
        )

    def feed_scales(self, first: int, behind: int) -> Array:
        """Return the feed scales of segments ``first`` … ``behind`` - 1."""
        return np.full(behind - first, self.feeds.scale)

    def set_scales(self, first: int, scales: Array) -> None:
        """Set the scales of segments from ``first`` on."""
        self.scale[first : first + len(scales)] = scales
        self._made.set_scales(first, scales)
