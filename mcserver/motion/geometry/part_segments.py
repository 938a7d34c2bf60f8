"""The parts of a spline that stand for lines on end, in columns."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.made_segments import MadeSegments
from mcserver.motion.geometry.path_columns import SPLINE, PathColumns, SplineParts, bits_of
from mcserver.motion.geometry.segment import Segment, columns_of
from mcserver.motion.geometry.spline_curve import Spline, SplineCurve


@dataclass(frozen=True, eq=False)
class PartSegments:
    """Parts of one spline, n of them, in a machine of K columns: a `SegmentSource`.

    Attributes:
        path: of the lines that they stand for. spline: moves ``columns_moved`` of the machine.
        places: its parameters where the parts begin and the last one ends, shape (n+1,).
        active: as of `Segment`, the same for all. feed, scale: as of `Segment`, shape (n,).
        slopes, bends: dp/ds and d²p/ds² at the start and the end of each, shape (2, n, K).
    """

    path: PathColumns
    spline: Spline
    columns_moved: NDArray[np.intp]
    places: Array
    active: int
    feed: Array
    scale: Array
    slopes: Array
    bends: Array
    _made: MadeSegments = field(default_factory=MadeSegments)

    def __len__(self) -> int:
        return len(self.feed)

    @property
    def mask(self) -> int:
        """Bits of the columns that the spline moves."""
        return bits_of(self.columns_moved)

    def segment(self, index: int) -> Segment:
        """Return one of them, always the same object."""
        return self._made.get(index, self._segment)

    def _segment(self, index: int) -> Segment:
        path = self.path
        low, high = self.places[index : index + 2].tolist()
        duration = float(path.duration[index])
        return Segment(
            line=int(path.line[index]),
            curves=(SplineCurve(tuple(self.columns_moved.tolist()), self.spline, low, high),),
            columns=(self.columns_moved,),
            mask=self.mask,
            duration=None if math.isnan(duration) else duration,
            feed=float(self.feed[index]),
            requested=float(path.requested[index]),
            first=self.slopes[0, index],
            last=self.slopes[1, index],
            d2q_start=self.bends[0, index],
            d2q_end=self.bends[1, index],
            scale=float(self.scale[index]),
            base=path.bases[index],
            end=path.ends[index],
            active=self.active,
            opens=bool(path.opens[index]),
            closes=bool(path.closes[index]),
            feed_speed=float(path.feed_speed[index]),
            feed_columns=columns_of(int(path.fed[index])),
            carried=() if path.carried is None else path.carried[index],
            feed_scale=float(path.feed_scale[index]),
        )

    def columns(self, first: int, behind: int) -> PathColumns:
        """Return the columns of segments ``first`` … ``behind`` - 1."""
        at, count, path = slice(first, behind), behind - first, self.path
        spans = np.zeros((count, 3))
        spans[:, 0], spans[:, 2] = self.scale[at], 1.0
        return PathColumns(
            path.line[at],
            np.full(count, self.active, np.uint64),
            path.opens[at],
            path.closes[at],
            path.feed_scale[at],
            np.full(count, SPLINE, np.int8),
            spans,
            path.bases[at],
            self.slopes[0, at],
            path.ends[at],
            np.full(count, self.mask, np.uint64),
            path.fed[at],
            path.duration[at],
            self.feed[at],
            path.requested[at],
            path.feed_speed[at],
            np.zeros(count),
            None,
            np.column_stack((self.places[:-1][at], self.places[1:][at])),
            (SplineParts(self.spline, self.columns_moved, 0, count),),
            None if path.carried is None else path.carried[at],
        )

    def feed_scales(self, first: int, behind: int) -> Array:
        """Return the feed scales of segments ``first`` … ``behind`` - 1."""
        return self.path.feed_scale[first:behind]

    def set_scales(self, first: int, scales: Array) -> None:
        """Set the scales of segments from ``first`` on."""
        self.scale[first : first + len(scales)] = scales
        self._made.set_scales(first, scales)
