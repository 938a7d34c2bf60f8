"""A spline at given parameters, and samples of the limits along it for the part of each line."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.polynomials import limit_of

# Samples of the limits per span of knots, on which q''' is one parabola.
SAMPLES_A_SPAN = 4
# A part with fewer steps than this is sampled evenly; a longer one, as where knots are far closer at one end
# of a long line than at the other, has the same number of samples in each span.
EVEN_STEPS = 128


class PartSamples(NamedTuple):
    """Samples of the limits of n parts in the parameter of their spline.

    Attributes:
        rows: see `mcserver.motion.kernels.sample_limits`. offset: the first of each part, and one past the
            last, shape (n+1,). spans: of the parts in that parameter, shape (n,).
    """

    rows: Array
    offset: NDArray[np.intp]
    spans: Array


@compiled
def spline_at(breaks: Array, spans: Array, t: Array, found: Array) -> None:
    """Write position and three derivatives of a spline, shape (4, n, K), at parameters ``t``, shape (n,).

    Args:
        breaks: where its m spans meet, shape (m+1,). spans: their polynomials, constant first, (m, 6, K).
    """
    span, last = 0, len(spans) - 1
    if len(t) > 0:
        span = min(max(np.searchsorted(breaks, t[0], side="right") - 1, 0), last)
    for i in range(len(t)):
        while span < last and breaks[span + 1] <= t[i]:
            span += 1
        while span > 0 and breaks[span] > t[i]:
            span -= 1
        x = t[i] - breaks[span]
        for k in range(spans.shape[2]):
            c1, c2, c3 = spans[span, 1, k], spans[span, 2, k], spans[span, 3, k]
            c4, c5 = spans[span, 4, k], spans[span, 5, k]
            found[0, i, k] = spans[span, 0, k] + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5))))
            found[1, i, k] = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))
            found[2, i, k] = 2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))
            found[3, i, k] = 6.0 * c3 + x * (24.0 * c4 + x * 60.0 * c5)


@compiled
def _spans_of(breaks: Array, first: int, begin: float, end: float) -> tuple[int, int]:
    """Return the first span of a part, at or behind ``first``, and how many it touches."""
    while first < len(breaks) - 2 and breaks[first + 1] <= begin:
        first += 1
    behind = first + 1
    while behind < len(breaks) - 1 and breaks[behind] < end:
        behind += 1
    return first, behind - first


@compiled
def _steps_a_span(count: int) -> int:
    """Return the steps of each of the spans of a part whose samples do not stand evenly."""
    return max(SAMPLES_A_SPAN, math.ceil(EVEN_STEPS / count))


@compiled
def count_samples(breaks: Array, t: Array, offset: NDArray[np.intp]) -> None:
    """Write where the samples of each part begin, and one past the last, shape (n+1,).

    Args:
        breaks: where the spans meet. t: where the n parts begin, and the end, shape (n+1,).
    """
    offset[0] = 0
    span = 0
    for part in range(len(t) - 1):
        span, count = _spans_of(breaks, span, t[part], t[part + 1])
        least = math.inf
        for which in range(span, span + count):
            least = min(least, breaks[which + 1] - breaks[which])
        steps = max(1, math.ceil((t[part + 1] - t[part]) / (least / SAMPLES_A_SPAN) - 1e-9))
        if steps >= EVEN_STEPS:
            steps = count * _steps_a_span(count)
        offset[part + 1] = offset[part] + steps + 1


@compiled
def greatest_between(f0: float, slope0: float, f1: float, slope1: float, apart: float) -> float:
    """Return the greatest |f| on an interval from f and f' at its ends: that of the cubic through them.

    For a function that is smooth at the scale of the interval this is nearly exact; the values at the ends
    alone would miss an extreme between them by up to apart²/8·|f''|.
    """
    most = max(abs(f0), abs(f1))
    if slope0 * slope1 >= 0.0:
        return most
    # f0 + rise·u + b·u² + c·u³ over u in [0, 1]: slopes of unlike sign have one extreme between them, here
    # the greatest value
    sign = 1.0 if slope0 > 0.0 else -1.0
    rise, change = sign * slope0 * apart, sign * (f1 - f0)
    b = 3.0 * change - apart * sign * (2.0 * slope0 + slope1)
    c = apart * sign * (slope0 + slope1) - 2.0 * change
    root = math.sqrt(max(b * b - 3.0 * c * rise, 0.0))
    above, below = (b + root, -3.0 * c) if b > 0.0 else (rise, root - b)
    if not below > 0.0:
        return most
    u = min(above / below, 1.0)
    return max(most, abs(sign * f0 + u * (rise + u * (b + u * c))))


@compiled
def sample_parts(
    breaks: Array,
    spans: Array,
    t: Array,
    offset: NDArray[np.intp],
    columns: NDArray[np.intp],
    fed: NDArray[np.bool_],
    rows: Array,
    slopes: Array,
) -> None:
    """Write samples in the spline's own parameter, as `mcserver.motion.kernels.sample_limits` has them.

    Both samples of an interval get the greatest value of a derivative on it.

    Args:
        spans: polynomials of K columns, shape (m, 6, K). offset: as `count_samples` writes it.
        columns: the machine's, shape (K,). fed: which of them each part's feed counts, shape (n, K).
        rows: zeroed; written. slopes: written: the greatest speed that feeds count by parameter, and of all
            columns, shape (n, 2).
    """
    width, count = (rows.shape[1] - 2) // 5, len(columns)
    # derivatives of orders 1 to 4 at the sample before and at this one
    before, here = np.empty((4, count)), np.empty((4, count))
    span = first = 0
    for part in range(len(t) - 1):
        steps = offset[part + 1] - offset[part] - 1
        first, touched = _spans_of(breaks, first, t[part], t[part + 1])
        each, place = _steps_a_span(touched), t[part]
        counted = every = counted_slope = every_slope = 0.0
        fastest = fastest_of_all = 0.0
        for i in range(steps + 1):
            last_place = place
            if steps < EVEN_STEPS or i == steps:
                place = t[part] + (t[part + 1] - t[part]) * i / steps
            else:
                which = first + i // each
                low, high = max(breaks[which], t[part]), min(breaks[which + 1], t[part + 1])
                place = low + (high - low) * (i % each) / each
            apart = place - last_place
            while span < len(spans) - 1 and breaks[span + 1] <= place:
                span += 1
            while span > 0 and breaks[span] > place:
                span -= 1
            x = place - breaks[span]
            at = offset[part] + i
            last_counted, last_every = counted, every
            last_counted_slope, last_every_slope = counted_slope, every_slope
            counted = every = counted_slope = every_slope = 0.0
            for k in range(count):
                c1, c2, c3 = spans[span, 1, k], spans[span, 2, k], spans[span, 3, k]
                c4, c5 = spans[span, 4, k], spans[span, 5, k]
                here[0, k] = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))
                here[1, k] = 2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))
                here[2, k] = 6.0 * c3 + x * (24.0 * c4 + x * 60.0 * c5)
                here[3, k] = 24.0 * c4 + x * 120.0 * c5
                for order in range(3):
                    value, column = abs(here[order, k]), order * width + columns[k]
                    if i > 0:
                        between = greatest_between(
                            before[order, k], before[order + 1, k], here[order, k], here[order + 1, k], apart
                        )
                        if between > max(abs(before[order, k]), value):
                            rows[at - 1, column] = max(rows[at - 1, column], between)
                            value = between
                    rows[at, column] = value
                square, change = here[0, k] * here[0, k], 2.0 * here[0, k] * here[1, k]
                every += square
                every_slope += change
                if fed[part, k]:
                    counted += square
                    counted_slope += change
            for order in range(4):
                for k in range(count):
                    before[order, k] = here[order, k]
            rows[at, 5 * width] = rows[at, 5 * width + 1] = math.inf
            if i > 0:
                between = greatest_between(last_counted, last_counted_slope, counted, counted_slope, apart)
                fastest = max(fastest, between)
                between = greatest_between(last_every, last_every_slope, every, every_slope, apart)
                fastest_of_all = max(fastest_of_all, between)
        slopes[part, 0], slopes[part, 1] = math.sqrt(fastest), math.sqrt(fastest_of_all)


@compiled
def scale_samples(
    rows: Array, unit: float, offset: NDArray[np.intp], limits: Array, vmax: Array, by: NDArray[np.intp]
) -> None:
    """Change samples to another parameter, and find the greatest constant speed on each part.

    Args:
        unit: d new / d old parameter. vmax: written, shape (n,). by: written: column and kind of its limit,
            shape (n, 2).
    """
    width = (rows.shape[1] - 2) // 5
    for row in rows:
        for k in range(width):
            row[k] /= unit
            row[width + k] /= unit * unit
            row[2 * width + k] /= unit * unit * unit
    for part in range(len(offset) - 1):
        vmax[part], by[part, 0], by[part, 1] = limit_of(rows[offset[part] : offset[part + 1]], limits)
