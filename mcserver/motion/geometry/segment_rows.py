"""Consecutive segments held as columns, each made as an object on access."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array, Curve
from mcserver.motion.geometry.path_columns import ARC_KIND, STRAIGHT, PathColumns
from mcserver.motion.geometry.segment import Segment, columns_of


@dataclass(frozen=True, eq=False)
class SegmentRows:
    """Columns of n consecutive segments in a machine of K columns.

    Attributes:
        path: the columns that are used in bulk. ends: dp/ds at start and end, then d²p/ds² there, of each
            segment, shape (n, 4, K).
        curve: returns curve and columns of a segment by its index; None where it needs no curve.
    """

    path: PathColumns
    ends: Array
    curve: Callable[[int], tuple[Curve, NDArray[np.intp]] | None]
    # callers may change a segment that they were given, so it is kept
    _made: dict[int, Segment] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.path)

    @property
    def mask(self) -> int:
        """Bits of all columns that any of them moves."""
        return int(np.bitwise_or.reduce(self.path.mask))

    def segment(self, index: int) -> Segment:
        """Return a segment; every call with the same index returns the same object."""
        found = self._made.get(index)
        if found is None:
            found = self._made[index] = self._segment(index)
        return found

    def _segment(self, index: int) -> Segment:
        path, kind = self.path, int(self.path.kind[index])
        curves: tuple[Curve, ...] = ()
        columns: tuple[NDArray[np.intp], ...] = ()
        found = self.curve(index)
        if found is not None:
            curves, columns = (found[0],), (found[1],)
        first, last, d2q_start, d2q_end = self.ends[index]
        duration = float(path.duration[index])
        return Segment(
            line=int(path.line[index]),
            curves=curves,
            columns=columns,
            mask=int(path.mask[index]),
            duration=None if math.isnan(duration) else duration,
            feed=float(path.feed[index]),
            requested=float(path.requested[index]),
            first=first,
            last=last,
            d2q_start=d2q_start,
            d2q_end=d2q_end,
            scale=float(path.spans[index, 0]),
            base=path.bases[index],
            end=path.ends[index],
            active=int(path.active[index]),
            opens=bool(path.opens[index]),
            closes=bool(path.closes[index]),
            straight=kind == STRAIGHT,
            feed_speed=float(path.feed_speed[index]),
            feed_columns=columns_of(int(path.fed[index])),
            lever=float(path.lever[index]),
            tolerance=float(path.tolerance[index]),
            carried=() if path.carried is None else path.carried[index],
            feed_scale=float(path.feed_scale[index]),
            arc=None if path.arcs is None or kind != ARC_KIND else path.arcs[index],
        )

    def columns(self, first: int, behind: int) -> PathColumns:
        """Return the columns of segments ``first`` … ``behind`` - 1."""
        return self.path.part(first, behind)

    def feed_scales(self, first: int, behind: int) -> Array:
        """Return the feed scales of segments ``first`` … ``behind`` - 1."""
        return self.path.feed_scale[first:behind]

    def set_scales(self, first: int, scales: Array) -> None:
        """Set the scales of segments from ``first`` on, shape (m,)."""
        self.path.spans[first : first + len(scales), 0] = scales
        for index, segment in self._made.items():
            if first <= index < first + len(scales):
                segment.scale = float(scales[index - first])
