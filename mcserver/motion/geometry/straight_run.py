"""A run of G01 lines in all columns of the machine: what the planner needs of a `PlainRun`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.canonical import PlainRun
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.run_segments import RunSegments
from mcserver.motion.geometry.segment import NO_TRAVEL


@dataclass(frozen=True)
class StraightRun:
    """A run of G01 lines in all columns of the machine: n straight segments on end.

    Attributes:
        points: shape (n+1, K), where each segment starts and the last one ends. travels: shape (n, K).
        scales: lengths of the travels, shape (n,). feeds: as `Segment.feed`, shape (n,). feed_columns: as of
            `Segment`, of all. feed_scale: that `feeds` are for.
    """

    run: PlainRun
    mask: int
    points: Array
    travels: Array
    scales: Array
    feeds: Array
    feed_columns: NDArray[np.intp]
    feed_scale: float = 1.0

    @classmethod
    def of(
        cls,
        run: PlainRun,
        slots: dict[int, int],
        linear: NDArray[np.bool_],
        position: Array,
        feed_scale: float = 1.0,
    ) -> StraightRun | None:
        """Return the segments from a ``position`` of all columns, shape (K,); None where a line does not
        travel.

        Args:
            slots, linear: as of `segment_of`.
        """
        columns = np.array([slots[axis] for axis in run.axes], np.intp)
        points = np.tile(position, (len(run) + 1, 1))
        points[:, columns] = run.points
        travels = np.zeros((len(run), len(position)))
        travels[:, columns] = np.diff(run.points, axis=0)
        scales = np.sqrt(np.einsum("ij,ij->i", travels, travels))
        if not scales.min() > NO_TRAVEL:
            return None
        feeds = np.full(len(run), math.inf)
        if run.speeds is not None:
            long = run.lengths > NO_TRAVEL
            np.divide(run.speeds, run.lengths, out=feeds, where=long)
            np.divide(1.0, run.requested, out=feeds, where=~long & (run.requested > 0.0))
            feeds *= feed_scale
        mask = sum(1 << column for column in columns.tolist())
        feed_columns = columns[linear[columns]] if linear[columns].any() else columns
        return cls(run, mask, points, travels, scales, feeds, feed_columns, feed_scale)

    @property
    def timing(self) -> Array:
        """Feed [1/s], requested time and T (NaN without one) of each segment [s], shape (n, 3)."""
        requested = self.run.requested / self.feed_scale
        duration = requested if self.run.speeds is None else np.full(len(requested), math.nan)
        return np.column_stack((self.feeds, requested, duration))

    def segments(self, scales: Array, active: int, tolerance: float = 0.0) -> RunSegments:
        """Return the segments, with coordinates scaled by ``scales``, shape (n,)."""
        count, timing = len(scales), self.timing
        speeds = np.full(count, math.inf) if self.run.speeds is None else self.run.speeds * self.feed_scale
        return RunSegments(
            line=self.run.lines,
            mask=np.full(count, self.mask, np.uint64),
            active=np.full(count, active, np.uint64),
            duration=timing[:, 2],
            feed=self.feeds,
            requested=timing[:, 1],
            feed_speed=speeds,
            scale=scales,
            points=self.points,
            ends=self.travels[:, None],
            frame=np.zeros(count, np.intp),
            feed_columns=(self.feed_columns,),
            tolerance=tolerance,
            feed_scale=self.feed_scale,
        )
