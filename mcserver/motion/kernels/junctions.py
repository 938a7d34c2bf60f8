"""Straight samples, and the speed over the joint of two segments (D-35, D-36)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.groups import (
    AFTER,
    BEFORE,
    CAP,
    COLUMN,
    DURATION,
    END,
    EXTENT,
    FEED,
    KEY,
    KIND,
    REQUESTED,
    SPEED,
    TOP,
)
from mcserver.motion.kernels.parts import is_long, near_vertex
from mcserver.motion.kernels.sample_limits import CURVATURE_SHARE, TINY, ripple

# A vertex is passed in one cycle. Beside it half of the limit is left, where that is all that there is on the
# way to the next one.
VERTEX_SHARE = 0.5
# Short segments that turn by less than this are a polyline in place of a curve [rad].
POLYLINE_TURN = 0.35
# A joint that can be passed at no more than this many times max_acceleration·dt is a stop.
CRAWL = 10.0
# Tangents that differ by less than this share of an axis's acceleration are one tangent.
_ONE_TANGENT = 1e-12


class Before(NamedTuple):
    """The end of the segment that others follow.

    Attributes:
        last, bend: dp/ds and d²p/ds² there, shape (K,). scale: of its coordinate; 0: they start at rest.
        in_parts: whether it is planned in parts if it is long.
    """

    last: Array
    bend: Array
    scale: float
    in_parts: bool


@compiled
def line_sample(travel: Array, scale: float, limits: Array, rows: Array) -> tuple[float, int]:
    """Writes the one sample of a straight segment into ``rows`` (1, 5 K + 2), zeroed before.

    Returns:
        The greatest speed along it, and the column that binds it.
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
    """Euclidean length of a vector (K,)."""
    total = 0.0
    for k in range(len(vector)):
        total += vector[k] * vector[k]
    return math.sqrt(total)


@compiled
def meet(
    last: Array,
    bend_last: Array,
    before_scale: float,
    first: Array,
    bend_first: Array,
    limits: Array,
    cycle: float,
    in_parts: bool,
    samples: Array,
) -> tuple[float, float]:
    """Speed over a joint, and what it asks of both sides.

    Args:
        last, bend_last: dp/ds and d²p/ds² at the end of the segment before, shape (K,). first, bend_first: at
            the start of the one after. before_scale: of the one before.
        in_parts: whether both are planned in parts if they are long.
        samples: shape (2, 5 K + 2), zeroed; written where the joint is passed with a bounded speed.

    Returns:
        The greatest speed (infinite: unbounded), and the scale of the segment after with which speed along σ
        is continuous; 0 where one of the two does not travel.
    """
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
        bent = max(bent, abs(bend_last[k]), abs(bend_first[k]))
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
        reach = near_vertex(most, crawl_limit, cycle)
        if in_parts and is_long(spacing, reach, reach, crawl_limit, most):
            # what it takes holds near it only, so it may take nearly all
            speed = most
        if turn < POLYLINE_TURN and spacing < 10.0 * cycle * dense:
            # many short segments: a polyline stands for a curve, and the speed is that of the curve
            speed = min(most, dense)
            isolated = False
        if isolated and speed < CRAWL * cycle * crawl_limit:
            return 0.0, 0.0
    sharpest = 0.0
    for k in range(width):
        b1, b2 = bend_last[k] / before_scale**2, bend_first[k] / scale**2
        bend = max(abs(b1), abs(b2))
        if worst > _ONE_TANGENT and bent > 0.0:
            # beside a vertex the bend of an arc takes its part of the same axis's acceleration: the greatest
            # v with step·v + bend·v² ≤ acceleration
            step = abs(first[k] / scale - last[k] / before_scale) / (cycle * VERTEX_SHARE)
            share = CURVATURE_SHARE * limits[1, k]
            speed = min(speed, 2.0 * share / max(step + math.sqrt(step * step + 4.0 * bend * share), TINY))
        sharpest = max(sharpest, abs(b2 - b1) / limits[2, k])
    if sharpest > 0.0:
        speed = min(speed, math.sqrt(VERTEX_SHARE * cycle / sharpest))
    if math.isinf(speed):
        return speed, scale
    for k in range(width):
        t1, t2 = last[k] / before_scale, first[k] / scale
        b1, b2 = bend_last[k] / before_scale**2, bend_first[k] / scale**2
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
def meet_lines(
    before: Before,
    travels: Array,
    scales: Array,
    asked: Array,
    limits: Array,
    cycle: float,
    numbers: Array,
    marks: NDArray[np.intp],
    rows: Array,
) -> tuple[int, bool]:
    """As `line_sample` and `meet`, for n straight segments on end.

    Args:
        before: what they follow. travels: shape (n, K). scales: their lengths, shape (n,).
        asked: feed [1/s], time and T of each [s], shape (n, 3).
        numbers, marks: of the nodes (see `mcserver.motion.kernels.groups`), shapes (n, `NUMBERS`) and
            (n, `MARKS`); written, `END` from the first of ``rows`` on.
        rows: shape (3 n, 5 K + 2), zeroed; written: the samples of all.

    Returns:
        How many rows there are, and whether the first is that of the vertex at the end of what was before.
    """
    still = np.zeros(travels.shape[1])
    vertex = np.zeros((2, rows.shape[1]))
    at, last_scale, last_in_parts = 0, before.scale, before.in_parts
    leads = False
    for i in range(len(travels)):
        speed = scale = 0.0
        in_parts = math.isnan(asked[i, 2])
        last, bend = (travels[i - 1], still) if i > 0 else (before.last, before.bend)
        if last_scale > 0.0:
            parts = in_parts and last_in_parts
            speed, scale = meet(last, bend, last_scale, travels[i], still, limits, cycle, parts, vertex)
        if not scale > 0.0:
            scale = scales[i]
        bounded = 0.0 < speed < math.inf
        if bounded:
            rows[at] = vertex[0]
            at += 1
            if i > 0:
                marks[i - 1, END] += 1
                marks[i - 1, AFTER] = 1
            else:
                leads = True
        top, marks[i, COLUMN] = line_sample(travels[i], scale, limits, rows[at : at + 1])
        at += 1
        if bounded:
            rows[at] = vertex[1]
            at += 1
        feed = asked[i, 0] * scale
        numbers[i, EXTENT], numbers[i, CAP] = scale, speed
        numbers[i, SPEED], numbers[i, FEED], numbers[i, TOP] = top, feed, min(top, feed)
        numbers[i, REQUESTED], numbers[i, DURATION] = asked[i, 1], asked[i, 2]
        marks[i, KIND], marks[i, END], marks[i, KEY] = 0, at, 0
        marks[i, BEFORE], marks[i, AFTER] = 1 if bounded else 0, 0
        last_scale, last_in_parts = scale, in_parts
    return at, leads
