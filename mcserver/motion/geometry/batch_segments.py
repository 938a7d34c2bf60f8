"""The segments of a `PathBatch`: consecutive lines and arcs in all columns of the machine."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.canonical import PathBatch
from mcserver.motion.geometry.curves import ArcCurve, Array, Curve, max_path_rates, samples_of_arcs
from mcserver.motion.geometry.path_columns import ARC_KIND, STRAIGHT, PathColumns, bits_of
from mcserver.motion.geometry.segment import NO_TRAVEL
from mcserver.motion.geometry.segment_rows import SegmentRows
from mcserver.motion.kernels.arc_segments import ARC


def segments_of_batch(
    run: PathBatch,
    slots: dict[int, int],
    linear: NDArray[np.bool_],
    position: Array,
    feed_scale: float = 1.0,
    active: int = 0,
) -> SegmentRows | None:
    """Return the segments of a batch; None where a line does not travel.

    Args:
        position: of all columns where the batch starts, shape (K,). slots, linear, feed_scale: as in
            `segment_of`. active: mask of the columns that the motion has moved before.
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
    spans = np.zeros((count, 3))
    spans[:, 0] = np.sqrt(np.einsum("ij,ij->i", ends[:, 0], ends[:, 0]))
    spans[:, 2] = 1.0
    if not spans[:, 0].min() > NO_TRAVEL:
        return None
    lengths = run.lengths.copy()
    lengths[curved] = max_path_rates(lengths[curved], *arcs[curved, 5:8].T)
    tips = run.tips
    if tips is not None:
        lengths = tips.fastest
    requested = run.requested / feed_scale
    masks = np.array([bits_of(each) for each in columns], np.uint64)[run.frame]
    counted = [bits_of(each[linear[each]] if linear[each].any() else each) for each in columns]
    whole = np.ones(count, np.bool_)

    def curve(index: int) -> tuple[Curve, NDArray[np.intp]] | None:
        frame, sweep, length = int(run.frame[index]), float(run.sweeps[index]), float(run.lengths[index])
        if tips is None and sweep == 0.0:
            return None
        axes, of_curve = run.frames[frame], columns[frame]
        start, end = (tuple(each) for each in points[index : index + 2, of_curve].tolist())
        if tips is not None:
            return tips.line(index, axes, (start, end), length), of_curve
        centre = (float(run.centres[index, 0]), float(run.centres[index, 1]))
        return ArcCurve(axes, start, end, centre, sweep, length), of_curve

    path = PathColumns(
        line=run.lines,
        active=np.bitwise_or.accumulate(masks) | np.uint64(active),
        opens=whole,
        closes=whole,
        feed_scale=np.full(count, feed_scale),
        kind=np.where(run.sweeps != 0.0, ARC_KIND, STRAIGHT).astype(np.int8),
        spans=spans,
        bases=points[:-1],
        travels=np.ascontiguousarray(ends[:, 0]),
        ends=points[1:],
        mask=masks,
        fed=np.array(counted, np.uint64)[run.frame],
        duration=requested if run.speeds is None else np.full(count, math.nan),
        feed=_feeds(run, lengths) * feed_scale,
        requested=requested,
        feed_speed=(
            np.full(count, math.inf) if run.speeds is None or tips is not None else run.speeds * feed_scale
        ),
        lever=np.ones(count) if tips is None else tips.levers,
        tolerance=np.minimum(run.tolerances, np.concatenate((run.tolerances[:1], run.tolerances[:-1]))),
        arcs=arcs,
    )
    return SegmentRows(path, ends, curve)


def _feeds(run: PathBatch, lengths: Array) -> Array:
    """Return the greatest ds/dt of lines, infinite under G93, shape (n,) [1/s].

    Args:
        lengths: as F counts them, shape (n,).
    """
    feeds = np.full(len(run), math.inf)
    if run.speeds is not None:
        long = lengths > NO_TRAVEL
        np.divide(run.speeds, lengths, out=feeds, where=long)
        np.divide(1.0, run.requested, out=feeds, where=~long & (run.requested > 0.0))
    return feeds


def _arcs(
    points: Array, planes: NDArray[np.intp], curved: NDArray[np.intp], run: PathBatch
) -> tuple[Array, Array]:
    """Return the arcs' rows, shape (m, `ARC`), and their `SegmentRows.ends` in their planes, (4, m, 2).

    Args:
        planes: columns of their planes' axes, shape (m, 2). curved: indices of the arcs in the batch, (m,).
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
