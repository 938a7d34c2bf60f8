"""The segments of a run, with the limits and samples of each in numpy columns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import Segment
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.geometry.segment_rows import SegmentRows
from mcserver.motion.geometry.spline_curve import spline_part
from mcserver.motion.kernels.groups import SegmentColumns, Segments
from mcserver.motion.kernels.polynomials import KINDS
from mcserver.motion.limits.growable_array import GrowableArray
from mcserver.motion.limits.path_limits import SpeedLimit

# Greatest speeds of a curve's parts are rounded down to steps of this ratio: at one feed rate they differ
# slightly from part to part, and each difference would cost a knot.
SPEED_STEP = 5e-4
# Tolerance for rounding when a speed is a whole step already.
STEP_ROUNDING = 1e-9
_INTEGER_COLUMNS = frozenset(("limit_column", "limit_kind", "sample_end", "vertex_before", "vertex_after"))
_DTYPES = tuple(
    np.dtype(np.intp if name in _INTEGER_COLUMNS else np.float64) for name in SegmentColumns._fields
)


def empty_columns(count: int) -> SegmentColumns:
    """Return uninitialized columns for ``count`` segments."""
    arrays: list[Any] = [np.empty(count, dtype) for dtype in _DTYPES]
    return SegmentColumns(*arrays)


@dataclass(frozen=True)
class SavedSegments:
    """A copy of the segments of a table from an index on, for `SegmentTable.put_back`."""

    index: int
    segments: SegmentList
    columns: tuple[NDArray[np.generic], ...]
    samples: Array


class SegmentTable:
    """Consecutive segments and their columns.

    Attributes:
        segments: the segments, n of them.

    Args:
        width: columns of the machine.
    """

    def __init__(self, width: int) -> None:
        self.segments = SegmentList()
        self._columns: tuple[GrowableArray[np.generic], ...] = tuple(GrowableArray(each) for each in _DTYPES)
        self._view: SegmentColumns | None = None
        self._samples: GrowableArray[np.float64] = GrowableArray(np.dtype(np.float64), (5 * width + 2,))
        self._dropped = 0
        self._passed = 0.0

    def __len__(self) -> int:
        return len(self.segments)

    @property
    def columns(self) -> SegmentColumns:
        """Columns of all segments; views that are valid until segments are added or dropped."""
        if self._view is None:
            arrays: list[Any] = [each.rows for each in self._columns]
            self._view = SegmentColumns(*arrays)
        return self._view

    @property
    def samples(self) -> Array:
        """Samples of all segments, as `Segments` has them."""
        return self._samples.rows

    @property
    def kernel_view(self) -> Segments:
        """The table for kernels."""
        return Segments(self.columns, self.samples, self._dropped, self._passed)

    @property
    def programmed_view(self) -> Segments | None:
        """The table for kernels at a feed scale of 1; None where no segment has a greater one."""
        scales = self.feed_scales
        if not (scales > 1.0).any():
            return None
        feed = self.columns.feed / scales
        vmax = np.minimum(self.columns.segment_vmax, feed)
        return self.kernel_view._replace(columns=self.columns._replace(feed=feed, segment_vmax=vmax))

    def with_stops(self, segments: Segments, at: NDArray[np.bool_]) -> Segments:
        """Return a view for kernels with stops at the starts of some segments, where vertices limit nothing.

        Args:
            segments: the view. at: mask of the segments, shape (n,).
        """
        columns, samples = segments.columns, self.samples.copy()
        (after,) = np.nonzero(at)
        ends = columns.sample_end - self._dropped
        vertices = np.concatenate((ends[after - 1] - 1, ends[after] - 1 - columns.vertex_after[after]))
        width = (samples.shape[1] - 2) // 5
        junction_vmax = columns.junction_vmax.copy()
        junction_vmax[after] = 0.0
        samples[vertices, 3 * width : 5 * width] = 0.0
        samples[vertices, -1] = np.inf
        return Segments(columns._replace(junction_vmax=junction_vmax), samples, self._dropped, self._passed)

    @property
    def timed(self) -> NDArray[np.bool_]:
        """Which segments have a T of their own, shape (n,)."""
        return ~np.isnan(self.columns.duration)

    @property
    def feed_scales(self) -> Array:
        """The feed scales that the segments are planned at, shape (n,)."""
        return self.segments.feed_scales()

    @property
    def bends_at_end(self) -> bool:
        """Whether the last segment is a curve."""
        width = (self.samples.shape[1] - 2) // 5
        return bool(self.samples_of(len(self) - 1)[:, width : 2 * width].any())

    def samples_of(self, index: int) -> Array:
        """Return the samples of one segment, those of its vertices included."""
        ends = self.columns.sample_end
        low = self._dropped if index == 0 else int(ends[index - 1])
        return self.samples[low - self._dropped : int(ends[index]) - self._dropped]

    def limit_of(self, index: int) -> SpeedLimit:
        """Return the greatest speed that the axes allow on one segment, and what bounds it."""
        columns = self.columns
        kind = KINDS[int(columns.limit_kind[index])]
        return SpeedLimit(float(columns.axis_vmax[index]), int(columns.limit_column[index]), kind)

    # ------------------------------------------------------------------ growing and shrinking

    def append(
        self, segment: Segment, junction_vmax: float, limit: SpeedLimit, samples: Array, vertex: Array | None
    ) -> None:
        """Add a segment.

        Args:
            junction_vmax: greatest speed at its start. limit: by the axes. samples: of it alone,
                shape (m, 5 K + 2).
            vertex: samples of the vertex at its start, of the segment before and of this one,
                shape (2, 5 K + 2); None without a vertex.
        """
        if vertex is not None:
            self._samples.add(vertex[:1])
            self.columns.sample_end[-1] += 1
            self.columns.vertex_after[-1] += 1
        self._samples.add(samples)
        if vertex is not None:
            self._samples.add(vertex[1:])
        feed = segment.feed * segment.scale
        values = (
            segment.extent,
            segment.begin * segment.scale,
            segment.scale,
            junction_vmax,
            min(limit.velocity, feed),
            limit.velocity,
            feed,
            segment.requested,
            _duration_of(segment),
            segment.tolerance,
            limit.column,
            KINDS.index(limit.kind),
            self._dropped + len(self.samples),
            int(vertex is not None),
            0,
        )
        for column, value in zip(self._columns, values, strict=True):
            column.add_one(value)
        self._view = None
        self.segments.append(segment)

    def append_path(
        self, lines: SegmentRows, columns: SegmentColumns, samples: Array, *, leads: bool
    ) -> None:
        """Add consecutive lines and arcs, and set their scales.

        Args:
            columns: of them, with ``sample_end`` counted from the first of ``samples``. samples: theirs.
            leads: the first of ``samples`` belongs to the vertex at the end of the present last segment.
        """
        if leads:
            self.columns.sample_end[-1] += 1
            self.columns.vertex_after[-1] += 1
        columns.tolerance[:] = 0.0
        lines.set_scales(0, columns.length)
        self._extend(SegmentList.of(lines), columns, samples)

    def append_parts(
        self,
        parts: SegmentList,
        vmax: Array,
        by: NDArray[np.intp],
        samples: Array,
        offset: NDArray[np.intp],
    ) -> None:
        """Add segments whose junctions are continuous in all derivatives.

        Args:
            vmax, by: greatest speeds by the axes, shape (n,), and column and kind of the limit, shape (n, 2).
            samples, offset: their samples, and where those of each begin and end, shape (n+1,).
        """
        columns = empty_columns(len(parts))
        plan = parts.columns(0, len(parts))
        scale, begin, finish = plan.spans.T
        columns.length[:], columns.begin[:], columns.whole[:] = scale * (finish - begin), scale * begin, scale
        columns.feed[:] = plan.feed * scale
        columns.requested[:] = plan.requested
        columns.junction_vmax[:] = np.inf
        columns.axis_vmax[:] = vmax
        columns.duration[:], columns.tolerance[:] = plan.duration, 0.0
        columns.segment_vmax[:] = _stepped(np.minimum(vmax, columns.feed), np.isnan(columns.duration))
        columns.limit_column[:], columns.limit_kind[:] = by.T
        columns.sample_end[:] = offset[1:]
        columns.vertex_before[:] = columns.vertex_after[:] = 0
        self._extend(parts, columns, samples)

    def _extend(self, segments: SegmentList, columns: SegmentColumns, samples: Array) -> None:
        """Add segments with their columns, ``sample_end`` counted from the first of ``samples``."""
        columns.sample_end[:] += self._dropped + len(self.samples)
        self._samples.add(samples)
        self.segments.extend(segments)
        for own, new in zip(self._columns, columns, strict=True):
            own.add(new)
        self._view = None

    def replace(self, index: int, segment: Segment) -> None:
        """Replace a segment by a trimmed one."""
        if index == 0:
            self._passed += (segment.begin - self.segments[0].begin) * segment.scale
        self.segments[index] = segment
        self.columns.length[index] = segment.extent
        self.columns.begin[index] = segment.begin * segment.scale
        self.columns.duration[index] = _duration_of(segment)

    def set_feed_scale(self, scale: float, first: int = 0) -> None:
        """Set the feed scale of the segments from ``first`` on."""
        columns, segments = self.columns, list(self.segments[first:])
        shares = scale / self.feed_scales[first:]
        splines = np.zeros(len(shares), np.bool_)
        for index in np.nonzero(shares != 1.0)[0].tolist():
            segment = segments[index]
            segments[index] = segment.at_feed_scale(scale)
            splines[index] = segment.duration is None and spline_part(segment) is not None
        self.segments.truncate(first)
        self.segments.extend(segments)
        columns.feed[first:] *= shares
        columns.requested[first:] /= shares
        columns.duration[first:] /= shares
        vmax = _stepped(np.minimum(columns.axis_vmax[first:], columns.feed[first:]), splines)
        np.copyto(columns.segment_vmax[first:], vmax, where=shares != 1.0)

    def drop(self, count: int) -> None:
        """Remove the first segments."""
        if count == 0:
            return
        samples = int(self.columns.sample_end[count - 1]) - self._dropped
        self._dropped += samples
        self._passed = 0.0
        self._samples.drop(samples)
        for column in self._columns:
            column.drop(count)
        self._view = None
        self.segments.drop(count)

    def save(self, index: int) -> SavedSegments:
        """Copy the segments from ``index`` on, without the samples of the vertex on the segment before."""
        low = self._first_sample(index)
        columns = tuple(each.rows[index:].copy() for each in self._columns)
        return SavedSegments(index, self.segments[index:], columns, self.samples[low:].copy())

    def truncate(self, count: int) -> None:
        """Remove all but the first ``count`` segments, and the samples of the vertex at their end."""
        columns = self.columns
        if count > 0:
            columns.sample_end[count - 1] -= columns.vertex_after[count - 1]
            columns.vertex_after[count - 1] = 0
        self._samples.truncate(self._first_sample(count))
        self.segments.truncate(count)
        for column in self._columns:
            column.truncate(count)
        self._view = None

    def put_back(self, saved: SavedSegments) -> None:
        """Replace the present segments by saved ones.

        The segment before them must have the same samples as when they were saved.
        """
        self._samples.truncate(self._first_sample(saved.index))
        self._samples.add(saved.samples)
        self.segments.truncate(saved.index)
        self.segments.extend(saved.segments)
        for column, values in zip(self._columns, saved.columns, strict=True):
            column.truncate(saved.index)
            column.add(values)
        self._view = None

    def _first_sample(self, index: int) -> int:
        """Return where the samples of a segment begin; for the index after the last one, where they would."""
        return int(self.columns.sample_end[index - 1]) - self._dropped if index > 0 else 0


def _stepped(vmax: Array, where: NDArray[np.bool_]) -> Array:
    """Round greatest speeds down to whole steps where ``where`` is set."""
    steps = np.floor(np.log(vmax, where=where, out=np.zeros_like(vmax)) / SPEED_STEP + STEP_ROUNDING)
    return np.where(where, np.minimum(np.exp(SPEED_STEP * steps), vmax), vmax)


def _duration_of(segment: Segment) -> float:
    """T of a segment [s]; NaN without one."""
    return math.nan if segment.duration is None else segment.duration
