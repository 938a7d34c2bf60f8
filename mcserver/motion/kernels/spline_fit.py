"""The smoothest quintic B-spline within a tolerance of a polyline.

It minimizes ∫ |q(t) - p(t)|² + L(t)⁶ |q'''(t)|² dt, where p is the polyline over its own length t. As a
filter that is 1 / (1 + (ω L)⁶): features of the polyline much shorter than L, the vertices of short chords
and the rounding of their coordinates, vanish; curves with a radius of several L stay where they are. L is as
long as the tolerance allows, locally: where q leaves the tolerance it is shortened.

Such a curve runs between the chords and their vertices. Where L is no longer than the chords themselves,
their vertices turn alike, and q misses them by little, the minimum within the tolerance is computed instead
of shortening L, by the alternating direction method of multipliers (Boyd et al., Distributed Optimization and
Statistical Learning via ADMM, chapter 5).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.spline_basis import DEGREE, ORDER, taylor_of_spans
from mcserver.motion.kernels.spline_equations import (
    GRADE,
    Equations,
    Samples,
    bind_end,
    equations,
    reach_at,
    sample,
    solve,
)

# Spacing of knots as a share of L; of samples and of checked points as shares of the knot spacing.
KNOT_STEP, SAMPLE_STEP, CHECK_STEP = 0.8, 0.5, 0.34
# ADMM steps for one L, their penalty, and the share of the tolerance that they aim at.
STEPS, PENALTY, TUBE = 40, 100.0, 0.96
# ADMM is used where the plain fit misses by at most so many tolerances,
NEAR = 8.0
# and L is at most so many chords, between vertices that turn alike: the fit then misses the chords, not the
# curve that they approximate.
SHORT = 0.6
# The whole curve is checked once no sample is farther than so many times the aim,
CLOSE = 1.02
# at points this close, as a share of the knot spacing.
CLOSE_STEP = 0.12
# Factor of L where the steps did not succeed.
LESS = 0.7
# Most fits that are tried.
ROUNDS = 32
# Share of the tolerance that plain fits aim at.
AIM = 0.9
# Bounds of the factor by which L shrinks from one plain fit to the next.
LEAST, MOST = 0.88, 0.35
# The shortest L, in tolerances: a corner that turns back on itself would have no shortest one.
FLOOR = 0.1
# Number of conditions at an end: its position only, where the motion rests, or position and three
# derivatives.
AT_REST, JOINED = 1, 4
# Most samples of one chord.
MOST_SAMPLES = 200
# Least step to the next checked point, as a share of a chord.
LEAST_STEP = 1e-6


@compiled
def _grade(t: Array, reach: Array) -> None:
    """Shorten L at vertices, shape (n+1,), until it changes no faster than `GRADE`."""
    for i in range(1, len(t)):
        reach[i] = min(reach[i], reach[i - 1] + GRADE * (t[i] - t[i - 1]))
    for i in range(len(t) - 2, -1, -1):
        reach[i] = min(reach[i], reach[i + 1] + GRADE * (t[i + 1] - t[i]))


@compiled
def _place_knots(t: Array, reach: Array, longest: float, most: int) -> Array:
    """Return clamped knots whose spacing follows L; empty where there would be more than ``most``."""
    inner = np.empty(most)
    count, chord, place, end = 0, 0, t[0], t[-1]
    while place < end and count < most:
        while chord < len(t) - 2 and t[chord + 1] <= place:
            chord += 1
        place += KNOT_STEP * reach_at(t, reach, chord, place, longest)
        inner[count] = place
        count += 1
    if count >= most:
        return np.empty(0)
    # leave out a last span that is mostly beyond the curve's end
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
def _draw_within(samples: Samples, control: Array, multipliers: Array, targets: Array) -> float:
    """Take one ADMM step towards the minimum with all samples within their limits.

    Args:
        multipliers: scaled multipliers of the samples, shape (S, K); updated.
        targets: written: targets of the next curve.

    Returns:
        The greatest distance from the polyline, in limits.
    """
    width = control.shape[1]
    place, moved = np.empty(width), np.empty(width)
    worst = 0.0
    for at in range(len(targets)):
        first, square, apart = samples.firsts[at], 0.0, 0.0
        for k in range(width):
            place[k] = 0.0
            for a in range(ORDER):
                place[k] += samples.values[at, a] * control[first + a, k]
            moved[k] = place[k] + multipliers[at, k] - samples.places[at, k]
            square += moved[k] ** 2
            apart += (place[k] - samples.places[at, k]) ** 2
        worst = max(worst, apart / samples.limits[at] ** 2)
        share = min(1.0, samples.limits[at] / math.sqrt(square)) if square > 0.0 else 1.0
        for k in range(width):
            kept = share * moved[k]
            multipliers[at, k] = moved[k] - kept
            pull = PENALTY * (kept - multipliers[at, k]) / (1.0 + PENALTY)
            targets[at, k] = samples.places[at, k] + pull
    return math.sqrt(worst)


@compiled
def position_and_bend(spans: Array, span: int, x: float, k: int) -> tuple[float, float]:
    """Return position and second derivative of one column at x after the start of a span."""
    position = bend = 0.0
    for order in range(DEGREE, -1, -1):
        position = position * x + spans[span, order, k]
        if order >= 2:
            bend = bend * x + order * (order - 1) * spans[span, order, k]
    return position, bend


@compiled
def deviations(t: Array, points: Array, knots: Array, spans: Array, check: float, found: Array) -> None:
    """Write upper bounds of the distances between the curve and each chord, shape (n,).

    The distance is taken at equal parameters, which bounds the distance in both directions. Between checked
    points g apart it is greater by at most g²/8 |q''|.
    """
    width = points.shape[1]
    span = 0
    for chord in range(len(t) - 1):
        low, high = t[chord], t[chord + 1]
        # knots are far closer at a vertex than along a line: steps follow their spacing
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
            place += max(check * (knots[span + ORDER] - knots[span + DEGREE]), LEAST_STEP * (high - low))
        found[chord] = math.sqrt(worst) + between


@compiled
def _drawn_within(
    drawn: Equations, samples: Samples, control: Array, polyline: tuple[Array, Array, Array], knots: Array
) -> tuple[bool, Array, Array]:
    """Take ADMM steps until the curve is within the tolerance.

    Args:
        drawn: of a curve by `samples`. control: control points to begin with.
        polyline: see `fit`: t, points, tolerances.

    Returns:
        Whether it is within, its spans, and its distance from each chord.
    """
    t, points, tolerances = polyline
    missed = np.empty(len(tolerances))
    spans = np.empty((len(control) - DEGREE, ORDER, points.shape[1]))
    targets, multipliers = np.empty(samples.places.shape), np.zeros(samples.places.shape)
    for step in range(STEPS + 1):
        worst = _draw_within(samples, control, multipliers, targets)
        if step and (worst <= CLOSE or step == STEPS):
            taylor_of_spans(knots, control, spans)
            deviations(t, points, knots, spans, CLOSE_STEP, missed)
            if (missed <= tolerances).all():
                return True, spans, missed
        control = solve(drawn, samples, targets)
    return False, spans, missed


@compiled
def _shorten(t: Array, missed: Array, tolerances: Array, even: NDArray[np.bool_], reach: Array) -> bool:
    """Shorten L where a plain fit misses chords by more than ADMM steps could mend.

    Returns:
        Whether L was shortened anywhere.
    """
    shorter = reach.copy()
    far = False
    for chord in range(len(missed)):
        share = missed[chord] / tolerances[chord]
        short = min(reach[chord], reach[chord + 1]) <= SHORT * (t[chord + 1] - t[chord])
        if share > 1.0 and not (short and even[chord] and share < NEAR):
            far = True
            factor = max(MOST, min(LEAST, math.sqrt(AIM / share)))
            for vertex in (chord, chord + 1):
                shorter[vertex] = min(shorter[vertex], factor * reach[vertex])
    reach[:] = shorter
    return far


@compiled
def fit(
    t: Array,
    points: Array,
    reach: Array,
    longest: float,
    tolerances: Array,
    even: NDArray[np.bool_],
    start: tuple[int, Array],
    end: tuple[int, Array],
) -> tuple[bool, Array, Array]:
    """Fit the spline.

    Args:
        t, points: the polyline over its length, shapes (n+1,) and (n+1, K).
        reach: initial L at the vertices, shape (n+1,); written: the final one.
        longest: the longest L. tolerances: of the chords, shape (n,). even: whether the vertices at both of
            their ends turn alike, shape (n,).
        start, end: number of conditions there (`AT_REST`, `JOINED`), and position and three derivatives,
            shape (4, K).

    Returns:
        Whether it was found; the knots, clamped, and the polynomials of its m spans, shape (m, 6, K).
    """
    width = points.shape[1]
    missed, counts = np.empty(len(t) - 1), np.empty(len(t) - 1, np.intp)
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
        known = np.zeros((len(knots) - ORDER, width))
        bind_end(knots, known, start[1], start[0], True)
        bind_end(knots, known, end[1], end[0], False)
        for chord in range(len(counts)):
            step = SAMPLE_STEP * KNOT_STEP * min(reach[chord], reach[chord + 1])
            counts[chord] = max(1, min(MOST_SAMPLES, math.ceil((t[chord + 1] - t[chord]) / step)))
        samples = sample(t, points, TUBE * tolerances, counts, knots)
        plain = equations(t, reach, longest, knots, samples, known, (start[0], end[0]))
        if not plain.solvable:
            break
        control = solve(plain, samples, samples.places)
        spans = np.empty((len(control) - DEGREE, ORDER, width))
        taylor_of_spans(knots, control, spans)
        deviations(t, points, knots, spans, CHECK_STEP, missed)
        if (missed <= tolerances).all():
            return True, knots, spans
        if _shorten(t, missed, tolerances, even, reach):
            continue
        samples.weights[:] *= 1.0 + PENALTY
        drawn = equations(t, reach, longest, knots, samples, known, (start[0], end[0]))
        if not drawn.solvable:
            break
        within, spans, missed = _drawn_within(drawn, samples, control, (t, points, tolerances), knots)
        if within:
            return True, knots, spans
        shorter = reach.copy()
        for chord in range(len(missed)):
            if missed[chord] > tolerances[chord]:
                shorter[chord] = min(shorter[chord], LESS * reach[chord])
                shorter[chord + 1] = min(shorter[chord + 1], LESS * reach[chord + 1])
        reach[:] = shorter
    return False, nothing[0], nothing[1]
