"""The smoothest quintic B-spline within a tolerance of a polyline.

It minimizes ∫ |q(t) - p(t)|² + L(t)⁶ |q'''(t)|² dt, where p is the polyline over its own length t. As a
filter that is 1 / (1 + (ω L)⁶): features of the polyline much shorter than L, the vertices of short chords
and the digits that their coordinates are rounded to, vanish; curves whose radius is some times L stay where
they are. L is as long as the tolerance allows, place by place: where q leaves the tolerance it is shortened.
"""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.spline_basis import (
    DEGREE,
    ORDER,
    basis,
    basis_derivatives,
    taylor_of_spans,
)

# Spacing of knots, samples of the polyline and places that are checked, as shares of L and of that spacing.
KNOT_STEP, SAMPLE_STEP, CHECK_STEP = 0.8, 0.5, 0.34
# How fast L may change along the curve.
GRADE = 0.3
# Fits that are tried; what is aimed at of the tolerance; the least and most that L shrinks by between them.
ROUNDS, AIM, LEAST, MOST = 24, 0.9, 0.88, 0.35
# The shortest L, in tolerances: a corner that turns back on itself has no shorter one.
FLOOR = 0.1
# Conditions at an end: its place alone, where the motion rests, or place and three derivatives.
AT_REST, JOINED = 1, 4
# Samples of one chord at most, and the least step to the next place that is checked, as a share of a chord.
MOST_SAMPLES, LEAST_STEP = 200, 1e-6
# Gauss-Legendre quadrature with three places, exact for the square of a third derivative.
_PLACES = (0.5 - 0.5 * math.sqrt(0.6), 0.5, 0.5 + 0.5 * math.sqrt(0.6))
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


@compiled
def _grade(t: Array, reach: Array) -> None:
    """Shorten L at vertices, shape (n+1,), until it changes no faster than `GRADE`."""
    for i in range(1, len(t)):
        reach[i] = min(reach[i], reach[i - 1] + GRADE * (t[i] - t[i - 1]))
    for i in range(len(t) - 2, -1, -1):
        reach[i] = min(reach[i], reach[i + 1] + GRADE * (t[i + 1] - t[i]))


@compiled
def _reach_at(t: Array, reach: Array, chord: int, place: float, longest: float) -> float:
    """L at a place of a chord."""
    before = reach[chord] + GRADE * (place - t[chord])
    after = reach[chord + 1] + GRADE * (t[chord + 1] - place)
    reached: float = min(before, after, longest)
    return reached


@compiled
def _place_knots(t: Array, reach: Array, longest: float, most: int) -> Array:
    """Clamped knots whose spacing follows L; empty where they would be more than ``most``."""
    inner = np.empty(most)
    count, chord, place, end = 0, 0, t[0], t[-1]
    while place < end and count < most:
        while chord < len(t) - 2 and t[chord + 1] <= place:
            chord += 1
        place += KNOT_STEP * _reach_at(t, reach, chord, place, longest)
        inner[count] = place
        count += 1
    if count >= most:
        return np.empty(0)
    # a last span that hardly reaches into the curve is left out
    if count > 1 and inner[count - 1] - end > 0.5 * (inner[count - 1] - inner[count - 2]):
        count -= 1
    spans = max(count, 4)
    knots = np.empty(spans + 1 + 2 * DEGREE)
    knots[:ORDER] = t[0]
    knots[-ORDER:] = end
    factor = (end - t[0]) / (inner[count - 1] - t[0])
    for i in range(1, spans):
        along = factor * (inner[i - 1] - t[0]) if count >= 4 else (end - t[0]) * i / spans
        knots[DEGREE + i] = t[0] + along
    return knots


@compiled
def _bind_end(knots: Array, control: Array, jet: Array, conditions: int, first: bool) -> None:
    """Write the control points at an end that give its place and the derivatives there.

    Args:
        jet: place and three derivatives, shape (4, K).
    """
    n, width = control.shape
    values = np.empty((4, ORDER))
    span = DEGREE if first else n - 1
    basis_derivatives(knots, span, knots[0] if first else knots[-1], 3, values)
    for order in range(conditions):
        for k in range(width):
            total = jet[order, k]
            for j in range(order):
                at, value = (j, values[order, j]) if first else (n - 1 - j, values[order, DEGREE - j])
                total -= value * control[at, k]
            if first:
                control[order, k] = total / values[order, order]
            else:
                control[n - 1 - order, k] = total / values[order, DEGREE - order]


@compiled
def _assemble(
    t: Array, points: Array, reach: Array, longest: float, knots: Array, band: Array, right: Array
) -> None:
    """Add up the normal equations.

    Args:
        band: upper half of the symmetric matrix, shape (n, 6), zeroed. right: right-hand sides, shape (n, K),
            zeroed.
    """
    width = points.shape[1]
    values = np.empty(ORDER)
    derivatives = np.empty((4, ORDER))
    span, last = DEGREE, len(knots) - ORDER - 1
    for chord in range(len(t) - 1):
        low, length = t[chord], t[chord + 1] - t[chord]
        step = SAMPLE_STEP * KNOT_STEP * min(reach[chord], reach[chord + 1])
        count = max(1, min(MOST_SAMPLES, math.ceil(length / step)))
        for i in range(count + 1):
            share = i / count
            place = low + share * length
            weight = length / count * (0.5 if i in (0, count) else 1.0)
            while span < last and knots[span + 1] <= place:
                span += 1
            while span > DEGREE and knots[span] > place:
                span -= 1
            basis(knots, span, place, values)
            first = span - DEGREE
            for a in range(ORDER):
                part = weight * values[a]
                for b in range(a, ORDER):
                    band[first + a, b - a] += part * values[b]
                for k in range(width):
                    target = points[chord, k] + share * (points[chord + 1, k] - points[chord, k])
                    right[first + a, k] += part * target
    chord = 0
    for span in range(DEGREE, last + 1):
        low, length = knots[span], knots[span + 1] - knots[span]
        first = span - DEGREE
        middle = low + 0.5 * length
        while chord < len(t) - 2 and t[chord + 1] <= middle:
            chord += 1
        stiffness = _reach_at(t, reach, chord, middle, longest) ** 6
        for which in range(len(_PLACES)):
            basis_derivatives(knots, span, low + _PLACES[which] * length, 3, derivatives)
            for a in range(ORDER):
                part = stiffness * _WEIGHTS[which] * length * derivatives[3, a]
                for b in range(a, ORDER):
                    band[first + a, b - a] += part * derivatives[3, b]


@compiled
def _fix(band: Array, right: Array, control: Array, index: int) -> None:
    """Take a control point that is known out of the equations."""
    n, width = control.shape
    for d in range(1, ORDER):
        if index + d < n:
            for k in range(width):
                right[index + d, k] -= band[index, d] * control[index, k]
        band[index, d] = 0.0
        if index - d >= 0:
            for k in range(width):
                right[index - d, k] -= band[index - d, d] * control[index, k]
            band[index - d, d] = 0.0
    band[index, 0] = 1.0
    for k in range(width):
        right[index, k] = control[index, k]


@compiled
def _solve(band: Array, right: Array) -> bool:
    """Solve the banded equations by LDLᵀ in place; False where they are singular."""
    n, width = right.shape
    for i in range(n):
        pivot = band[i, 0]
        if not pivot > 0.0:
            return False
        for d in range(1, min(ORDER, n - i)):
            factor = band[i, d] / pivot
            for e in range(d, min(ORDER, n - i)):
                band[i + d, e - d] -= factor * band[i, e]
            for k in range(width):
                right[i + d, k] -= factor * right[i, k]
    for i in range(n - 1, -1, -1):
        for k in range(width):
            total = right[i, k]
            for d in range(1, min(ORDER, n - i)):
                total -= band[i, d] * right[i + d, k]
            right[i, k] = total / band[i, 0]
    return True


@compiled
def position_and_bend(spans: Array, span: int, x: float, k: int) -> tuple[float, float]:
    """Position and second derivative of one column at x behind the start of a span."""
    position = bend = 0.0
    for order in range(DEGREE, -1, -1):
        position = position * x + spans[span, order, k]
        if order >= 2:
            bend = bend * x + order * (order - 1) * spans[span, order, k]
    return position, bend


@compiled
def deviations(t: Array, points: Array, knots: Array, spans: Array, found: Array) -> None:
    """Write how far the curve and each chord are from each other at most, shape (n,).

    The distance is taken between equal parameters, which bounds the distance in both directions. Between
    places g apart that are looked at it is more by no more than g²/8 |q''|.
    """
    width = points.shape[1]
    span = 0
    for chord in range(len(t) - 1):
        low, high = t[chord], t[chord + 1]
        # knots stand far closer at a vertex than along a line: steps follow them
        place, last_place, last_bend = low, low, 0.0
        worst = between = 0.0
        done = False
        while not done:
            done = place >= high
            if done:
                place = high
            while span < len(spans) - 1 and knots[span + ORDER] <= place:
                span += 1
            x = place - knots[span + DEGREE]
            share = (place - low) / (high - low)
            square = bent = 0.0
            for k in range(width):
                position, bend = position_and_bend(spans, span, x, k)
                gap = position - (points[chord, k] + share * (points[chord + 1, k] - points[chord, k]))
                square += gap * gap
                bent += bend * bend
            apart, bent = place - last_place, math.sqrt(bent)
            worst = max(worst, square)
            between = max(between, apart * apart / 8.0 * max(bent, last_bend))
            last_place, last_bend = place, bent
            place += max(CHECK_STEP * (knots[span + ORDER] - knots[span + DEGREE]), LEAST_STEP * (high - low))
        found[chord] = math.sqrt(worst) + between


@compiled
def fit(
    t: Array,
    points: Array,
    reach: Array,
    longest: float,
    tolerances: Array,
    start: tuple[int, Array],
    end: tuple[int, Array],
) -> tuple[bool, Array, Array]:
    """Fit the spline.

    Args:
        t, points: the polyline over its length, shapes (n+1,) and (n+1, K).
        reach: L at the vertices to begin with, shape (n+1,); written: what was found.
        longest: the longest L. tolerances: of the chords, shape (n,).
        start, end: how many conditions hold there (`AT_REST`, `JOINED`), and place and three derivatives,
            shape (4, K).

    Returns:
        Whether it was found; the knots, clamped, and the polynomials of its m spans, shape (m, 6, K).
    """
    width = points.shape[1]
    missed = np.empty(len(t) - 1)
    shrunk = np.empty(len(t))
    least = FLOOR * tolerances.min()
    most = 64 + 64 * len(t)
    nothing = np.empty(0), np.empty((0, ORDER, width))
    for _ in range(ROUNDS):
        _grade(t, reach)
        if reach.min() < least:
            break
        knots = _place_knots(t, reach, longest, most)
        if len(knots) == 0:
            break
        n = len(knots) - ORDER
        control = np.zeros((n, width))
        _bind_end(knots, control, start[1], start[0], True)
        _bind_end(knots, control, end[1], end[0], False)
        band, right = np.zeros((n, ORDER)), np.zeros((n, width))
        _assemble(t, points, reach, longest, knots, band, right)
        for index in range(start[0]):
            _fix(band, right, control, index)
        for index in range(end[0]):
            _fix(band, right, control, n - 1 - index)
        if not _solve(band, right):
            break
        spans = np.empty((n - DEGREE, ORDER, width))
        taylor_of_spans(knots, right, spans)
        deviations(t, points, knots, spans, missed)
        kept = True
        shrunk[:] = reach
        for chord in range(len(missed)):
            share = missed[chord] / tolerances[chord]
            if share > 1.0:
                kept = False
                factor = max(MOST, min(LEAST, math.sqrt(AIM / share)))
                for vertex in (chord, chord + 1):
                    shrunk[vertex] = min(shrunk[vertex], factor * reach[vertex])
        if kept:
            return True, knots, spans
        reach[:] = shrunk
    return False, nothing[0], nothing[1]


@compiled
def first_reach(t: Array, turns: Array, tolerances: Array, share: float, longest: float) -> Array:
    """L at the vertices to begin with: as long as a single vertex allows, and no longer than ``longest``.

    Args:
        turns: at the inner vertices, shape (n-1,) [rad].
    """
    reach = np.full(len(t), longest)
    for i in range(len(turns)):
        if turns[i] > 0.0:
            tolerance = min(tolerances[i], tolerances[i + 1])
            reach[i + 1] = min(longest, share * tolerance / turns[i])
    return reach
