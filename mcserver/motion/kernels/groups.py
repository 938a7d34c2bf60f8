"""Columns of a run's segments, and the groups into which they are joined or split for planning."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.parts import is_split, straight_limits, vertex_zone_length
from mcserver.motion.kernels.sample_limits import limit_junctions, limit_short_segments

# Longest time of a group of several segments [cycles].
GROUP = 4.0
# Least ratio of the speed limits in a group.
SAME = 0.9
# Least length of a zone, as a share of its segment.
DUST = 1e-9


class SegmentColumns(NamedTuple):
    """Properties of n segments, shape (n,) each.

    Attributes:
        length: along σ [m or rad]. whole: length of the curve before it was trimmed, which is the part that
            its samples stand on; begin: where on that the segment begins [m or rad].
        junction_vmax: greatest speed at the start, by the junction with the segment before [m/s or rad/s
            along σ]. segment_vmax: greatest speed on it, by its feed and the axes.
        axis_vmax: by the axes alone. feed: by its feed alone. requested: time asked for [s]. duration: T
            under G93, NaN without one [s]. tolerance: how far a stop at its start may be rounded [m].
        limit_column, limit_kind: the machine's column and the kind of limit that set ``axis_vmax``.
        sample_end: one past its last sample, counted from the first sample ever appended.
        vertex_before, vertex_after: 1 where it has the sample of a vertex at its start, or its end; else 0.
    """

    length: Array
    begin: Array
    whole: Array
    junction_vmax: Array
    segment_vmax: Array
    axis_vmax: Array
    feed: Array
    requested: Array
    duration: Array
    tolerance: Array
    limit_column: NDArray[np.intp]
    limit_kind: NDArray[np.intp]
    sample_end: NDArray[np.intp]
    vertex_before: NDArray[np.intp]
    vertex_after: NDArray[np.intp]


class Segments(NamedTuple):
    """The n segments of a run.

    Attributes:
        columns: their properties. samples: for each segment its own, then that of a vertex at its start, then
            that of one at its end; rows of `mcserver.motion.kernels.sample_limits`, shape (m, 5 K + 2).
        dropped: number of samples dropped before the first one. passed: length of the first segment that has
            been passed already, along σ.
    """

    columns: SegmentColumns
    samples: Array
    dropped: int
    passed: float


class Groups(NamedTuple):
    """The n segments of a run in g groups.

    Attributes:
        bounds: σ at the segments' starts and at the end, shape (n+1,). starts: the groups' first segments,
            the same one for all zones of a long segment, shape (g,).
        edges: σ at the groups' starts and at the end, shape (g+1,).
        junction_vmax: greatest speeds at the groups' starts and at the end, shape (g+1,). segment_vmax: on
            the groups, (g,).
        rows: samples of the groups. offset: the groups' first samples, and one past the last, (g+1,).
    """

    bounds: Array
    starts: NDArray[np.intp]
    edges: Array
    junction_vmax: Array
    segment_vmax: Array
    rows: Array
    offset: NDArray[np.intp]


@compiled
def _group_starts(
    segments: Segments, junction_vmax: Array, segment_vmax: Array, cycle: float
) -> NDArray[np.intp]:
    """Join short segments with similar speed limits into groups; return the groups' first segments.

    The lowest limit of its segments holds for all of a group. It lasts a few cycles only, so this costs
    hardly any time, and a curve made of very short lines is planned in steps of milliseconds.
    """
    columns = segments.columns
    count = len(segment_vmax)
    starts = np.empty(count, np.intp)
    starts[0] = 0
    found = 1
    span = GROUP * cycle
    low = high = segment_vmax[0]
    length = columns.length[0]
    for index in range(1, count):
        least = min(low, junction_vmax[index], segment_vmax[index])
        most = max(high, segment_vmax[index])
        # a slow vertex at an end of the group would slow all of it; and the rest of a long segment keeps the
        # limits that the motion on it was planned with
        first = starts[found - 1]
        slow = columns.vertex_before[first] != 0 and columns.junction_vmax[first] < SAME * most
        slow = slow or (columns.vertex_after[index] != 0 and junction_vmax[index + 1] < SAME * most)
        alone = (
            slow
            or (first == 0 and segments.passed > 0.0)
            or not math.isnan(columns.duration[index])
            or not math.isnan(columns.duration[first])
            or least < SAME * most
            or length + columns.length[index] > span * least
        )
        if alone:
            starts[found] = index
            found += 1
            low = high = segment_vmax[index]
            length = columns.length[index]
        else:
            low, high = least, most
            length += columns.length[index]
    return starts[:found]


@compiled
def line_row(segments: Segments, index: int) -> int:
    """Return the row of the one sample of a straight segment; -1 for any other segment."""
    columns = segments.columns
    low = columns.sample_end[index - 1] - segments.dropped if index > 0 else 0
    own = (
        columns.sample_end[index]
        - segments.dropped
        - low
        - columns.vertex_before[index]
        - columns.vertex_after[index]
    )
    return low if own == 1 else -1


@compiled
def _vertex_zones(
    segments: Segments, starts: NDArray[np.intp], segment_vmax: Array, limits: Array, cycle: float
) -> tuple[NDArray[np.bool_], Array]:
    """Find long segments to split into zones.

    Returns:
        Which groups are one long segment, shape (n,); σ on it at which the zone of the vertex at its start
        ends, and at which that of the vertex at its end begins, shape (n, 2).
    """
    columns = segments.columns
    n = len(starts)
    long, cuts = np.zeros(n, np.bool_), np.zeros((n, 2))
    for group in range(n):
        first = starts[group]
        last = starts[group + 1] if group + 1 < n else len(segment_vmax)
        row = line_row(segments, first)
        if last - first > 1 or row < 0 or columns.vertex_before[first] + columns.vertex_after[first] == 0:
            continue
        if not math.isnan(columns.duration[first]):
            continue
        acceleration, _ = straight_limits(segments.samples[row], limits)
        before = after = fastest = 0.0
        if columns.vertex_before[first] != 0:
            fastest = min(columns.junction_vmax[first], segment_vmax[first])
            before = vertex_zone_length(fastest, acceleration, cycle)
        if columns.vertex_after[first] != 0:
            speed = min(columns.junction_vmax[first + 1], segment_vmax[first])
            after, fastest = vertex_zone_length(speed, acceleration, cycle), max(fastest, speed)
        # a segment that was split stays so while it is passed: the motion was planned with these limits
        extent, gone = columns.length[first], segments.passed if first == 0 else 0.0
        long[group] = is_split(extent + gone, before, after, acceleration, fastest)
        dust = DUST * (extent + gone)
        cuts[group, 0] = before - gone if before - gone > dust else 0.0
        cuts[group, 1] = extent - after if after > dust else extent
        if cuts[group, 1] < dust:
            cuts[group, 1] = 0.0
    return long, cuts


@compiled
def _split_groups(groups: Groups, segments: Segments, long: NDArray[np.bool_], cuts: Array) -> Groups:
    """Split long segments into up to three zones: near the vertices at start and end, and between."""
    count = len(groups.starts)
    most = count + 2 * long.sum()
    starts = np.empty(most, np.intp)
    edges, junction_vmax = np.empty(most + 1), np.empty(most + 1)
    segment_vmax, offset = np.empty(most), np.zeros(most + 1, np.intp)
    rows = np.empty((len(segments.samples) + 2 * long.sum(), segments.samples.shape[1]))
    at = part = 0
    for group in range(count):
        low, high = groups.offset[group], groups.offset[group + 1]
        begin, extent = groups.edges[group], segments.columns.length[groups.starts[group]]
        places = (0.0, cuts[group, 0], cuts[group, 1], extent) if long[group] else (0.0, 0.0, 1.0, 1.0)
        for place in range(3):
            if places[place + 1] <= places[place]:
                continue
            opens = places[place] <= 0.0
            starts[part], segment_vmax[part] = groups.starts[group], groups.segment_vmax[group]
            edges[part] = begin if opens else begin + places[place]
            junction_vmax[part] = groups.junction_vmax[group] if opens else groups.segment_vmax[group]
            for i in range(low, high):
                # each zone of a long segment has the segment's own sample, and that of its own vertex
                if not long[group] or i == low or i == (low + 1, -1, high - 1)[place]:
                    rows[at] = segments.samples[i]
                    at += 1
            part += 1
            offset[part] = at
    edges[part], junction_vmax[part] = groups.edges[count], groups.junction_vmax[count]
    return Groups(
        groups.bounds,
        starts[:part],
        edges[: part + 1],
        junction_vmax[: part + 1],
        segment_vmax[:part],
        rows[:at],
        offset[: part + 1],
    )


@compiled
def group_segments(segments: Segments, entry: float, limits: Array, cycle: float) -> Groups:
    """Return the groups of a run that is entered at the speed ``entry`` and ends at rest."""
    columns = segments.columns
    count = len(columns.length)
    bounds = np.empty(count + 1)
    bounds[0] = 0.0
    junction_vmax = np.empty(count + 1)
    segment_vmax = np.empty(count)
    for i in range(count):
        bounds[i + 1] = bounds[i] + columns.length[i]
        junction_vmax[i], segment_vmax[i] = columns.junction_vmax[i], columns.segment_vmax[i]
    junction_vmax[0], junction_vmax[count] = entry, 0.0
    limit_short_segments(bounds, junction_vmax, segment_vmax, cycle)
    limit_junctions(junction_vmax, segment_vmax)
    starts = _group_starts(segments, junction_vmax, segment_vmax, cycle)
    n = len(starts)
    edges, group_junction_vmax = np.empty(n + 1), np.empty(n + 1)
    group_vmax = np.empty(n)
    offset = np.empty(n + 1, np.intp)
    offset[0] = 0
    for group in range(n):
        first = starts[group]
        last = starts[group + 1] if group + 1 < n else count
        edges[group], group_junction_vmax[group] = bounds[first], junction_vmax[first]
        top = segment_vmax[first]
        for i in range(first + 1, last):
            top = min(top, segment_vmax[i], junction_vmax[i])
        group_vmax[group] = top
        offset[group + 1] = columns.sample_end[last - 1] - segments.dropped
    edges[n], group_junction_vmax[n] = bounds[count], 0.0
    groups = Groups(bounds, starts, edges, group_junction_vmax, group_vmax, segments.samples, offset)
    long, cuts = _vertex_zones(segments, starts, segment_vmax, limits, cycle)
    return _split_groups(groups, segments, long, cuts) if long.any() else groups
