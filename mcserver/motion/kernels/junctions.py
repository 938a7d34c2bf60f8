"""Samples of a straight segment, and the greatest speed over a junction (D-35, D-36)."""

from __future__ import annotations

import math
from typing import NamedTuple

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.groups import SegmentColumns
from mcserver.motion.kernels.parts import is_split, vertex_zone_length
from mcserver.motion.kernels.sample_limits import CURVATURE_SHARE, MOST_RIPPLE, TINY, ripple

# Share of the acceleration that the step of velocity at a vertex may take; the rest is for the motion between
# vertices.
VERTEX_SHARE = 0.5
# Short segments that turn by less than this approximate a curve [rad].
POLYLINE_TURN = 0.35
# A junction whose speed limit is at most this many times max_acceleration·dt is a stop.
CRAWL = 10.0
# Share of the jerk limit that a step of velocity may take, where that limit holds at vertices too.
STEP_JERK = 0.02
# A change of the tangent below this share of an axis's acceleration is none.
_ONE_TANGENT = 1e-12


class PrecedingEnd(NamedTuple):
    """The end of the segment before a junction.

    Attributes:
        last, d2q: dp/ds and d²p/ds² there, shape (K,). scale: of its coordinate; 0: the next segment starts
            at rest. may_be_split: whether it is planned in zones if it is long.
    """

    last: Array
    d2q: Array
    scale: float
    may_be_split: bool


@compiled
def line_sample(travel: Array, scale: float, limits: Array, rows: Array) -> tuple[float, int]:
    """Write the one sample of a straight segment into ``rows`` (1, 5 K + 2), zeroed before.

    Returns:
        The greatest speed along it, and the column that limits it.
    """
    width = len(travel)
    best, column = math.inf, 0
    for k in range(width):
        slope = abs(travel[k]) / scale
        rows[0, k] = slope
        speed = limits[0, k] / max(slope, TINY)
        if speed < best:
            best, column = speed, k
    rows[0, 5 * width] = math.inf
    rows[0, 5 * width + 1] = math.inf
    return best, column


@compiled
def length_of(vector: Array) -> float:
    """Return the euclidean length of a vector (K,)."""
    total = 0.0
    for k in range(len(vector)):
        total += vector[k] * vector[k]
    return math.sqrt(total)


@compiled
def junction_vmax_of(
    before: PrecedingEnd,
    first: Array,
    d2q_start: Array,
    limits: Array,
    cycle: float,
    may_be_split: bool,
    jerk_too: bool,
    samples: Array,
) -> tuple[float, float]:
    """Return the greatest speed over a junction, and write its samples for both sides.

    Args:
        before: end of the segment before. first, d2q_start: dp/ds and d²p/ds² at the start of the segment
            after, shape (K,). may_be_split: whether that is planned in zones if it is long.
        jerk_too: whether a step of velocity has to keep the jerk limits, not only acceleration in a cycle.
        samples: shape (2, 5 K + 2), zeroed; written where the junction has a finite speed above 0.

    Returns:
        The greatest speed (infinite: unlimited), and the scale of the segment after with which speed along σ
        is continuous; 0 where one of the two does not travel.
    """
    last, d2q_end, before_scale, before_may_be_split = before
    width = len(last)
    end, begin = length_of(last), length_of(first)
    if end <= 0.0 or begin <= 0.0:
        return 0.0, 0.0
    scale = begin * before_scale / end
    worst = turned = bent = 0.0
    crawl_limit = math.inf
    for k in range(width):
        t1, t2 = last[k] / before_scale, first[k] / scale
        step = abs(t2 - t1)
        worst = max(worst, step / limits[1, k])
        turned += step * step
        bent = max(bent, abs(d2q_end[k]), abs(d2q_start[k]))
        crawl_limit = min(crawl_limit, limits[1, k] / max(abs(t1), abs(t2), TINY))
    speed = math.inf
    spacing = min(before_scale, scale)
    if worst > _ONE_TANGENT:
        speed = VERTEX_SHARE * cycle / worst
        isolated = True
        dense = math.sqrt(CURVATURE_SHARE * spacing / worst)
        dense /= math.sqrt(1.0 + ripple(min(1.0, spacing / (dense * cycle))))
        turn = math.sqrt(turned) * before_scale / end
        most = CURVATURE_SHARE * cycle / worst
        zone = vertex_zone_length(most, crawl_limit, cycle)
        if before_may_be_split and may_be_split and is_split(spacing, zone, zone, crawl_limit, most):
            # the vertex has a zone of its own, so it may take nearly all of the acceleration
            speed = most
        if turn < POLYLINE_TURN and spacing < 10.0 * cycle * dense:
            # many short segments approximate a curve: use the speed of the curve
            speed = min(most, dense)
            isolated = False
        if jerk_too:
            for k in range(width):
                step = abs(first[k] / scale - last[k] / before_scale)
                # a step of velocity within a cycle is a third difference of step/dt²
                smooth = STEP_JERK * limits[2, k] * cycle * cycle / max(step, TINY)
                if smooth < speed:
                    speed, isolated = smooth, True
        if isolated and speed < CRAWL * cycle * crawl_limit:
            return 0.0, 0.0
    sharpest = 0.0
    for k in range(width):
        b1, b2 = d2q_end[k] / before_scale**2, d2q_start[k] / scale**2
        d2q = max(abs(b1), abs(b2))
        if worst > _ONE_TANGENT and bent > 0.0:
            # the curvature of an arc takes its part of the same axis's acceleration: the greatest v with
            # step·v + bend·v² ≤ acceleration
            jump = abs(first[k] / scale - last[k] / before_scale)
            step = jump / (cycle * VERTEX_SHARE)
            share = CURVATURE_SHARE * limits[1, k]
            speed = min(speed, 2.0 * share / max(step + math.sqrt(step * step + 4.0 * d2q * share), TINY))
            if speed * cycle > spacing:
                # of several vertices within a cycle the steps add up, as step/spacing·v² (`free_at`)
                bend = MOST_RIPPLE * jump / spacing + d2q
                speed = min(speed, max(math.sqrt(share / max(bend, TINY)), spacing / cycle))
        sharpest = max(sharpest, abs(b2 - b1) / limits[2, k])
    if sharpest > 0.0:
        speed = min(speed, math.sqrt(VERTEX_SHARE * cycle / sharpest))
    if math.isinf(speed):
        return speed, scale
    for k in range(width):
        t1, t2 = last[k] / before_scale, first[k] / scale
        b1, b2 = d2q_end[k] / before_scale**2, d2q_start[k] / scale**2
        for side in range(2):
            samples[side, k] = abs(t1) if side == 0 else abs(t2)
            samples[side, width + k] = max(abs(b1), abs(b2))
            samples[side, 3 * width + k] = abs(t2 - t1)
            samples[side, 4 * width + k] = abs(b2 - b1)
    for side in range(2):
        samples[side, 5 * width] = spacing
        samples[side, 5 * width + 1] = speed
    return speed, scale


@compiled
def write_columns(
    columns: SegmentColumns,
    i: int,
    at: int,
    scale: float,
    junction_vmax: float,
    axis_vmax: float,
    column: int,
    kind: int,
    timing: Array,
) -> None:
    """Write the columns of segment i; a vertex at its start is also the one at the end of segment i - 1.

    Args:
        at: one past its last sample. axis_vmax, column, kind: as `limit_of` returns them.
        timing: feed, requested time and T, a row of ``timing`` of `append_path_junctions`.
    """
    bounded = 0.0 < junction_vmax < math.inf
    if bounded and i > 0:
        columns.sample_end[i - 1] += 1
        columns.vertex_after[i - 1] = 1
    feed = timing[0] * scale
    columns.length[i], columns.begin[i], columns.whole[i] = scale, 0.0, scale
    columns.junction_vmax[i] = junction_vmax
    columns.axis_vmax[i], columns.feed[i], columns.segment_vmax[i] = axis_vmax, feed, min(axis_vmax, feed)
    columns.requested[i], columns.duration[i] = timing[1], timing[2]
    columns.limit_column[i], columns.limit_kind[i] = column, kind
    columns.sample_end[i] = at
    columns.vertex_before[i], columns.vertex_after[i] = 1 if bounded else 0, 0
