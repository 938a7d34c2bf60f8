"""Consecutive lines and arcs: samples of their limits, and junctions.

An arc is a row of `ARC` numbers: the columns of its plane's two axes, its centre there, the angle at its
start, its sweep, the radius at its start, how far the radius grows, and how many samples its limits take; all
zeros but the last, a 1, is a straight line.
"""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.groups import SegmentColumns
from mcserver.motion.kernels.junctions import PrecedingEnd, junction_vmax_of, line_sample, write_columns
from mcserver.motion.kernels.polynomials import limit_of

# Length of the row of an arc.
ARC = 9


@compiled
def arc_samples(
    arc: Array, travel: Array, scale: float, limits: Array, rows: Array
) -> tuple[float, int, int]:
    """Write samples of an arc or helix in σ = s·scale, of one turn if it has more.

    Args:
        arc: shape (`ARC`,). travel: dp/ds of the columns beside the plane, shape (K,).
        rows: shape (n, 5 K + 2), zeroed; written.

    Returns:
        The greatest constant speed, as `limit_of` returns it.
    """
    width, count = len(travel), len(rows)
    first, second = int(arc[0]), int(arc[1])
    angle, sweep, radius, growth = arc[4], arc[5], arc[6], arc[7]
    # derivatives repeat after one turn
    most = min(1.0, 2.0 * math.pi / abs(sweep))
    for i in range(count):
        s = most * (i / (count - 1))
        cos, sin = math.cos(angle + sweep * s), math.sin(angle + sweep * s)
        r = radius + growth * s
        for k in range(width):
            rows[i, k] = abs(travel[k]) / scale
        rows[i, first] = abs(growth * cos - r * sweep * sin) / scale
        rows[i, second] = abs(growth * sin + r * sweep * cos) / scale
        bend, twist = sweep / scale**2, sweep**2 / scale**3
        rows[i, width + first] = abs((2.0 * growth * sin + r * sweep * cos) * bend)
        rows[i, width + second] = abs((2.0 * growth * cos - r * sweep * sin) * bend)
        rows[i, 2 * width + first] = abs((3.0 * growth * cos - r * sweep * sin) * twist)
        rows[i, 2 * width + second] = abs((3.0 * growth * sin + r * sweep * cos) * twist)
        rows[i, 5 * width] = math.inf
        rows[i, 5 * width + 1] = math.inf
    return limit_of(rows, limits)


@compiled
def append_path_junctions(
    before: PrecedingEnd,
    ends: Array,
    arcs: Array,
    scales: Array,
    timing: Array,
    limits: Array,
    cycle: float,
    columns: SegmentColumns,
    rows: Array,
) -> tuple[int, bool]:
    """Sample n consecutive lines and arcs, and find the greatest speeds over their junctions.

    Args:
        before: end of the segment that they follow. ends: dp/ds at start and end of each, then d²p/ds² there,
            shape (n, 4, K).
        arcs: shape (n, `ARC`). scales: lengths of dp/ds at the starts, shape (n,).
        timing: feed [1/s], time and T of each [s], shape (n, 3).
        columns: of the n segments, written, with ``sample_end`` counted from the first of ``rows``.
        rows: the samples of all segments, and room for two more each, shape (…, 5 K + 2), zeroed; written.

    Returns:
        The number of rows, and whether the first one belongs to the vertex at the end of ``before``.
    """
    vertex = np.zeros((2, rows.shape[1]))
    at, leads = 0, False
    for i in range(len(ends)):
        speed = scale = 0.0
        curved = arcs[i, 5] != 0.0
        may_be_split = math.isnan(timing[i, 2]) and not curved
        if before.scale > 0.0:
            speed, scale = junction_vmax_of(
                before, ends[i, 0], ends[i, 2], limits, cycle, may_be_split, False, vertex
            )
        if not scale > 0.0:
            scale = scales[i]
        bounded = 0.0 < speed < math.inf
        if bounded:
            rows[at] = vertex[0]
            at += 1
            leads |= i == 0
        kind = 0
        count = int(arcs[i, 8])
        if curved:
            own = rows[at : at + count]
            top, column, kind = arc_samples(arcs[i], ends[i, 0], scale, limits, own)
        else:
            top, column = line_sample(ends[i, 0], scale, limits, rows[at : at + count])
        at += count
        if bounded:
            rows[at] = vertex[1]
            at += 1
        write_columns(columns, i, at, scale, speed, top, column, kind, timing[i])
        before = PrecedingEnd(ends[i, 1], ends[i, 3], scale, may_be_split)
    return at, leads
