"""A run of G01 lines in all columns of the machine: what the planner needs of a `LineBatch`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.canonical import LineBatch
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.plan_columns import bits_of
from mcserver.motion.geometry.run_feeds import RunFeeds
from mcserver.motion.geometry.run_segments import RunSegments
from mcserver.motion.geometry.segment import NO_TRAVEL


@dataclass(frozen=True)
class StraightRun:
    """A run of G01 lines in all columns of the machine: n straight segments on end.

    Attributes:
        points: shape (n+1, K), where each segment starts and the last one ends. travels: shape (n, K).
        scales: lengths of the travels, shape (n,). feed_columns: as of `Segment`, of all.
    """

    run: LineBatch
    mask: int
    points: Array
    travels: Array
    scales: Array
    feeds: RunFeeds
    feed_columns: NDArray[np.intp]

    @classmethod
    def of(
        cls,
        run: LineBatch,
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
        feed_columns = columns[linear[columns]] if linear[columns].any() else columns
        feeds = RunFeeds.of(run, run.lengths, feed_scale)
        return cls(run, bits_of(columns), points, travels, scales, feeds, feed_columns)

    def segments(self, scales: Array, active: int, tolerance: float = 0.0) -> RunSegments:
        """Return the segments, with coordinates scaled by ``scales``, shape (n,)."""
        count = len(scales)
        return RunSegments(
            line=self.run.lines,
            mask=np.full(count, self.mask, np.uint64),
            active=np.full(count, active, np.uint64),
            feeds=self.feeds,
            scale=scales,
            points=self.points,
            ends=self.travels[:, None],
            frame=np.zeros(count, np.intp),
            feed_columns=(self.feed_columns,),
            tolerance=tolerance,
        )
