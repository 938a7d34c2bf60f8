"""Lines and arcs on end in all columns of the machine: what the planner needs of a `PathBatch`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.canonical import PathBatch
from mcserver.motion.geometry.curves import ArcCurve, Array, max_path_rates, samples_of_arcs
from mcserver.motion.geometry.path_columns import bits_of
from mcserver.motion.geometry.run_feeds import RunFeeds
from mcserver.motion.geometry.run_segments import RunSegments
from mcserver.motion.geometry.segment import NO_TRAVEL
from mcserver.motion.kernels.arc_segments import ARC


@dataclass(frozen=True)
class PathSegments:
    """A run of lines and arcs in all columns of the machine: n segments on end.

    Attributes:
        columns, masks, feed_columns: by the run's frames: the machine's columns of their axes, the same as
            bits, and as `Segment.feed_columns`.
        points: shape (n+1, K), where each segment starts and the last one ends.
        arcs: shape (n, `ARC`), see `mcserver.motion.kernels.arc_segments`.
        ends: dp/ds at the start and the end of each and d²p/ds² there, shape (n, 4, K).
        scales: lengths of dp/ds at the starts, shape (n,).
    """

    run: PathBatch
    columns: tuple[NDArray[np.intp], ...]
    masks: tuple[int, ...]
    feed_columns: tuple[NDArray[np.intp], ...]
    points: Array
    arcs: Array
    ends: Array
    scales: Array
    feeds: RunFeeds

    @classmethod
    def of(
        cls,
        run: PathBatch,
        slots: dict[int, int],
        linear: NDArray[np.bool_],
        position: Array,
        feed_scale: float = 1.0,
    ) -> PathSegments | None:
        """Return the segments from a ``position`` of all columns, shape (K,); None where a line does not
        travel.

        Args:
            slots, linear: as of `segment_of`.
        """
        count, width = len(run), len(position)
        columns = tuple(np.array([slots[axis] for axis in frame], np.intp) for frame in run.frames)
        points = np.tile(position, (count + 1, 1))
        points[:, [slots[axis] for axis in run.axes]] = run.points
        ends = np.zeros((count, 4, width))
        ends[:, 0] = ends[:, 1] = np.diff(points, axis=0)
        arcs = np.zeros((count, ARC))
        arcs[:, -1] = 1.0
        (curved,) = np.nonzero(run.sweeps)
        planes = np.array([each[:2] if len(each) > 1 else (0, 0) for each in columns])[run.frame]
        if len(curved):
            arcs[curved], plane_ends = _arcs(points, planes[curved], curved, run)
            for at in range(4):
                ends[curved[:, None], at, planes[curved]] = plane_ends[at]
        scales = np.sqrt(np.einsum("ij,ij->i", ends[:, 0], ends[:, 0]))
        if not scales.min() > NO_TRAVEL:
            return None
        lengths = run.lengths.copy()
        lengths[curved] = max_path_rates(lengths[curved], *arcs[curved, 5:8].T)
        feeds = RunFeeds.of(run, lengths, feed_scale)
        masks = tuple(bits_of(each) for each in columns)
        counted = tuple(each[linear[each]] if linear[each].any() else each for each in columns)
        return cls(run, columns, masks, counted, points, arcs, ends, scales, feeds)

    @property
    def mask(self) -> int:
        """Bits of all columns that any of them moves."""
        mask = 0
        for each in self.masks:
            mask |= each
        return mask

    def segments(self, scales: Array, active: int, tolerance: float = 0.0) -> RunSegments:
        """Return the segments, with coordinates scaled by ``scales``, shape (n,).

        Args:
            active: mask of the columns that the run of motion has moved before.
        """
        run = self.run
        masks = np.array(self.masks, np.uint64)[run.frame]
        curved = run.sweeps != 0.0
        return RunSegments(
            line=run.lines,
            mask=masks,
            active=np.bitwise_or.accumulate(masks) | np.uint64(active),
            feeds=self.feeds,
            scale=scales,
            points=self.points,
            ends=self.ends,
            frame=run.frame,
            feed_columns=self.feed_columns,
            tolerance=tolerance,
            arcs=(self.arcs, curved) if curved.any() else None,
            curve=self._curve,
        )

    def _curve(self, index: int) -> tuple[ArcCurve, NDArray[np.intp]]:
        """Return the curve of an arc and its columns."""
        run, frame = self.run, int(self.run.frame[index])
        columns = self.columns[frame]
        start = tuple(self.points[index, columns].tolist())
        end = tuple(self.points[index + 1, columns].tolist())
        centre = (float(run.centres[index, 0]), float(run.centres[index, 1]))
        sweep, length = float(run.sweeps[index]), float(run.lengths[index])
        return ArcCurve(run.frames[frame], start, end, centre, sweep, length), columns


def _arcs(
    points: Array, planes: NDArray[np.intp], curved: NDArray[np.intp], run: PathBatch
) -> tuple[Array, Array]:
    """Return the rows of arcs, shape (m, `ARC`), and their `PathSegments.ends` in their planes, (4, m, 2).

    Args:
        planes: columns of their planes' axes, shape (m, 2). curved: which of the run's lines they are, (m,).
    """
    centres, sweeps = run.centres[curved], run.sweeps[curved]
    x0, y0 = (points[curved[:, None], planes] - centres).T
    x1, y1 = (points[curved[:, None] + 1, planes] - centres).T
    angles, radii = np.arctan2(y0, x0), np.hypot(x0, y0)
    growths = np.hypot(x1, y1) - radii
    arcs = np.column_stack((planes, centres, angles, sweeps, radii, growths, samples_of_arcs(sweeps)))
    ends = np.empty((4, len(curved), 2))
    for at, (angle, radius) in enumerate(((angles, radii), (angles + sweeps, radii + growths))):
        cos, sin = np.cos(angle), np.sin(angle)
        ends[at] = np.stack((growths * cos - radius * sweeps * sin, growths * sin + radius * sweeps * cos), 1)
        along, across = 2.0 * growths * sweeps, radius * sweeps * sweeps
        ends[2 + at] = np.stack((-along * sin - across * cos, along * cos - across * sin), 1)
    return arcs, ends
