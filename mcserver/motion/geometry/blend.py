"""Corner blends within a tolerance: a quintic between two segments, with continuous tangent and curvature.

The blend leaves the first segment at a distance d before the vertex and joins the second one at d
after it. Its Bezier points continue tangent and curvature of both, so that velocity and acceleration
are continuous in every axis. Its largest distance from the programmed path, in either direction, is
measured, and d reduced until it is within the tolerance (D-35, D-36).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import POLYNOMIAL_SAMPLES, Array, PolynomialCurve
from mcserver.motion.geometry.segment import NO_TRAVEL, AxisLimits, Segment, columns_of
from mcserver.motion.kernels.junctions import length_of
from mcserver.motion.kernels.polynomials import polynomial_samples, power_basis, restrict_polynomial
from mcserver.motion.kernels.straight_corner import (
    Corner,
    best_blend_distance,
    distance_from_corner,
    max_distance_to_polyline,
    quintic,
)
from mcserver.units import MM

# Share of a segment that a blend at one of its ends may use: two blends never meet.
SHARE = 0.49
# Share of d for a Bezier handle at a right angle.
HANDLE = 0.4
# Shares of the path tolerance that are tried; the rest is for rows that miss the point nearest to the vertex.
TOLERANCE_SHARES = (0.85, 0.3)
# Least cosine of the turn that is rounded: a curve between nearly opposite tangents would turn on the spot.
REVERSAL = -0.95
# Bound on a tool's speed between two samples of a blend, as a multiple of the greater of theirs.
BETWEEN_SAMPLES = 1.001
_S = np.linspace(0.0, 1.0, POLYNOMIAL_SAMPLES)


@dataclass(frozen=True)
class Blend:
    """Two segments and the rounded corner between them, half of which belongs to each line."""

    before: Segment
    first: Segment
    second: Segment
    after: Segment


def blend(
    before: Segment,
    after: Segment,
    tolerance: float,
    per_axis: Array,
    per_joint: Array | None = None,
) -> Blend | None:
    """Round the corner between two segments; return None where that is not possible.

    Args:
        tolerance: largest distance from the programmed path [m].
        per_axis: weight of each column in that distance, shape (K,): 1 for metres; radians are weighted so
            that a degree counts as a millimetre.
        per_joint: weight of each column in the distance of joints that move a tool, shape (K,); None:
            measure that distance at the tool.
    """
    if not (can_be_rounded(before) and can_be_rounded(after)):
        return None
    t1 = before.last / math.sqrt(float(before.last @ before.last))
    t2 = after.first / math.sqrt(float(after.first @ after.first))
    if float(t1 @ t2) < REVERSAL:
        return None
    if per_joint is None:
        metric = corner_metric(before, after, per_axis)
    else:
        metric = np.diag(np.where(_moves_tool(before, after), per_joint, per_axis))
        if not np.isfinite(metric).all():
            return None
    longest = SHARE * min(_length_in(before), _length_in(after))
    # the blend of two lines passes the vertex at 0.22 to 0.3 d |t2 - t1|
    deviation_per_distance = 0.22 * float(np.linalg.norm(metric @ (t2 - t1)))
    distance = min(longest, tolerance / deviation_per_distance) if deviation_per_distance > 0.0 else longest
    cosine = float(t1 @ t2)
    handle = _handle(cosine)
    for _ in range(40):
        made = _fit(before, after, distance, handle, metric)
        if made is None:
            return None
        rounded, error = made
        if error <= tolerance:
            break
        distance *= max(0.5, 0.97 * min(1.0, tolerance / error))
    else:
        return None
    _keep_feed_of_tool(rounded.first, before, 1)
    _keep_feed_of_tool(rounded.second, after, 0)
    return rounded


def can_be_rounded(segment: Segment) -> bool:
    """Return whether a segment's corners may be rounded: those of lines, arcs, tool paths with a Jacobian."""
    return all(curve.roundable for curve in segment.curves)


def may_be_passed_in_time(segment: Segment) -> bool:
    """Return whether a stop at a segment's ends may be replaced by a time-domain blend.

    Lines and arcs under G94 may; tool paths have to stay near their pose, and G93 lines have to keep T.
    """
    return segment.duration is None and all(
        curve.roundable and curve.tool_rates is None for curve in segment.curves
    )


def corner_metric(before: Segment, after: Segment, per_axis: Array) -> Array:
    """Return the matrix from displacements of the columns to those that the path tolerance bounds.

    Args:
        per_axis: as for `blend`.

    Returns:
        Shape (m, K): a row for each column that moves no tool; for each tool that either segment moves, its
        Jacobian at the corner: rows for X Y Z [m], and for its rotation (a degree as a millimetre).
    """
    own = np.ones(len(per_axis), np.bool_)
    rows: list[Array] = []
    for segment, end in ((before, 1), (after, 0)):
        for curve, columns in zip(segment.curves, segment.columns, strict=True):
            if curve.tool_rates is None or not own[columns].all():
                continue
            own[columns] = False
            of_tool = curve.tool_rates(curve.position(np.array([float(end)])))[0]
            rates = np.zeros((len(of_tool), len(per_axis)))
            rates[:, columns] = of_tool
            rates[3:] *= MM / math.radians(1.0)
            rows.append(rates)
    metric: Array = np.concatenate([np.diag(per_axis)[own], *rows])
    return metric


def joint_weights(before: Segment, after: Segment, limits: AxisLimits) -> Array | None:
    """Return the weights of columns for a corner whose deviation is measured at a tool's joints.

    Returns:
        Path tolerance / joint tolerance, shape (K,); None without a joint tolerance, or where neither
        segment moves a tool.
    """
    allowed = limits.joint_tolerance
    if allowed is None or not _moves_tool(before, after).any():
        return None
    with np.errstate(divide="ignore"):
        weights: Array = after.tolerance / allowed
    return weights


def _moves_tool(before: Segment, after: Segment) -> NDArray[np.bool_]:
    """Return which columns move a tool by inverse kinematics, shape (K,)."""
    moves = np.zeros(len(before.base), np.bool_)
    for segment in (before, after):
        for curve, columns in zip(segment.curves, segment.columns, strict=True):
            if curve.tool_rates is not None:
                moves[columns] = True
    return moves


def _length_in(segment: Segment) -> float:
    """Return the remaining length of a segment over all columns; for a tool's path, a lower estimate."""
    rate = min(length_of(segment.first), length_of(segment.last))
    return rate * (segment.finish - segment.begin)


def _fit(
    before: Segment, after: Segment, distance: float, handle: float, metric: Array
) -> tuple[Blend, float] | None:
    leave = before.finish - distance / length_of(before.last)
    join = after.begin + distance / length_of(after.first)
    width = len(before.base)
    p0, v0, a0 = _at(before, leave, width)
    p5, v5, a5 = _at(after, join, width)
    # a column that only one of the two moves rests where that segment begins or ends
    p0 = np.where(_moved(before, width), p0, after.base)
    end = _at(before, before.finish, width)[0]
    p5 = np.where(_moved(after, width), p5, np.where(_moved(before, width), end, after.base))
    h = 5.0 * handle * distance
    p1 = p0 + v0 * (h / 5.0)
    p4 = p5 - v5 * (h / 5.0)
    p2 = 2.0 * p1 - p0 + a0 * (h * h / 20.0)
    p3 = 2.0 * p4 - p5 + a5 * (h * h / 20.0)
    mask = before.mask | after.mask
    columns = columns_of(mask)
    points = np.stack([p0, p1, p2, p3, p4, p5])
    power = np.empty_like(points)
    power_basis(points, power)
    # columns at rest keep their position to the last bit
    power[1:] *= np.isin(np.arange(width), columns)
    weight = metric[:, columns].T
    error = deviation(
        PolynomialCurve((), power[:, columns], 0.0).position(_S) @ weight,
        sample_programmed_path(before, after, leave, join)[:, columns] @ weight,
        straight=before.straight and after.straight,
    )
    made = _between(before, after, leave, join, power)
    return None if made is None else (made, error)


@dataclass(frozen=True)
class _Side:
    """The line to which half of a blend belongs, as ``segment``.

    Attributes:
        mask, base: of the blend. length: |dp/ds| of the line where it meets the blend.
    """

    segment: Segment
    mask: int
    base: Array
    length: float


def _between(before: Segment, after: Segment, leave: float, join: float, power: Array) -> Blend | None:
    """Return two segments trimmed at s = ``leave`` and ``join``, with the polynomial between them."""
    mask = before.mask | after.mask
    columns = columns_of(mask)
    width = len(before.base)
    before_slope, before_bend, _ = before.derivatives(np.array([leave]), width)
    after_slope, after_bend, _ = after.derivatives(np.array([join]), width)
    first = _half(power, 0.0, columns, _Side(before, mask, after.base, length_of(before_slope[0])))
    second = _half(power, 0.5, columns, _Side(after, mask, after.base, length_of(after_slope[0])))
    if first is None or second is None:
        return None
    first.opens = False
    second.closes = False
    return Blend(
        msgspec.structs.replace(
            before.between(before.begin, leave), last=before_slope[0], d2q_end=before_bend[0], closes=False
        ),
        first,
        second,
        msgspec.structs.replace(
            after.between(join, after.finish),
            first=after_slope[0],
            d2q_start=after_bend[0],
            opens=False,
            tolerance=0.0,
        ),
    )


def straight_blend(
    before: Segment,
    after: Segment,
    limits: AxisLimits,
    gain: float = 0.0,
) -> Blend | None:
    """Round the corner of two straight segments with the share of the tolerance that takes least time.

    Args:
        gain: time that a time-domain blend would save if the corner is a stop [s].

    Returns:
        None where no blend is faster than the corner itself, or the corner cannot be rounded.
    """
    if not (can_be_rounded(before) and can_be_rounded(after)):
        return None
    end, begin = length_of(before.first), length_of(after.first)
    t1, t2 = before.first / end, after.first / begin
    cosine = float(t1 @ t2)
    if cosine < REVERSAL:
        return None
    power = np.empty((6, len(t1)))
    quintic(t1, t2, _handle(cosine), power)
    deviation_per_distance = distance_from_corner(t1, t2, power, limits.weights)
    left, right = end * (before.finish - before.begin), begin * (after.finish - after.begin)
    longest = SHARE * min(left, right)
    reaches = np.array(
        [
            longest
            if deviation_per_distance <= 0.0
            else min(longest, share * after.tolerance / deviation_per_distance)
            for share in TOLERANCE_SHARES
        ]
    )
    feeds = np.array([before.feed * end, after.feed * begin])
    corner = Corner(before.first, after.first, feeds, limits.rows, limits.cycle)
    reach = best_blend_distance(corner, left, right, power, reaches, gain)
    if reach <= 0.0:
        return None
    power *= reach
    power[0] += after.base
    return _between(before, after, before.finish - reach / end, after.begin + reach / begin, power)


def _handle(cosine: float) -> float:
    """Return the share of d for a Bezier handle, shorter at sharp turns.

    At a turn of 0 a share of 0.4 spaces the Bezier points evenly, so that dp/ds is constant.
    """
    return HANDLE + 0.13 * min(cosine, 0.0)


def _moved(segment: Segment, width: int) -> Array:
    return np.array([bool(segment.mask >> column & 1) for column in range(width)])


def _at(segment: Segment, s: float, width: int) -> tuple[Array, Array, Array]:
    """Return position, unit tangent and curvature (both by arc length) at one s."""
    at = np.array([s])
    position = segment.sample(at)[0][0]
    slope, bend, _ = segment.derivatives(at, width)
    speed = math.sqrt(float(slope[0] @ slope[0]))
    return position, slope[0] / speed, bend[0] / speed**2


def _half(power: Array, low: float, columns: NDArray[np.intp], side: _Side) -> Segment | None:
    """Return half of a blend as a segment; None where dp/ds nearly vanishes.

    Args:
        power: coefficients in all columns, shape (n, K), constant first. low: parameter at which the half
            begins, 0 or 0.5. columns: those that move.
    """
    part = np.empty_like(power)
    restrict_polynomial(power, low, 0.5, part)
    rows = np.zeros((POLYNOMIAL_SAMPLES, 5 * power.shape[1] + 2))
    speeds = np.empty(POLYNOMIAL_SAMPLES)
    polynomial_samples(part, 1.0, rows, speeds)
    if speeds.min() <= 1e-3 * speeds.max():
        return None
    # keep the path speed of its line where dp/ds is greatest
    feed = side.segment.feed * side.length / float(speeds.max())
    if not side.segment.only_feed_columns:
        counted = PolynomialCurve((), part[:, side.segment.feed_columns], 0.0).derivatives(_S)[0]
        feed = min(feed, side.segment.feed_speed / max(float(np.linalg.norm(counted, axis=1).max()), 1e-300))
    orders = np.arange(len(part), dtype=np.float64)
    curve = PolynomialCurve(
        axes=tuple(columns.tolist()),
        coefficients=part[:, columns],
        length=float(np.trapezoid(speeds, dx=1.0 / (POLYNOMIAL_SAMPLES - 1))),
    )
    return msgspec.structs.replace(
        side.segment,
        curves=(curve,),
        columns=(columns,),
        mask=side.mask,
        feed=feed,
        requested=0.0,
        first=part[1].copy(),
        last=orders @ part,
        d2q_start=2.0 * part[2],
        d2q_end=(orders * (orders - 1.0)) @ part,
        scale=float(speeds[0]),
        begin=0.0,
        finish=1.0,
        base=side.base,
        opens=True,
        closes=True,
        straight=False,
        tolerance=0.0,
        arc=None,
    )


def _keep_feed_of_tool(half: Segment, line: Segment, end: int) -> None:
    """Limit half of a blend to the feed rate of its line at the tool, if inverse kinematics moves the tool.

    The joints of a tool that rotates much on a short path travel far, and their contributions to the tool's
    speed nearly cancel: a small change of the Jacobian changes that speed much. So |J(q)·dq/ds| is evaluated
    at the blend's own joint positions q, which are not those of the line.

    Args:
        half: is changed. end: s of the line at the vertex, 0 or 1.
    """
    for curve, columns in zip(line.curves, line.columns, strict=True):
        if curve.tool_rates is None:
            continue
        if line.feed_columns[0] not in columns:
            continue
        own = np.searchsorted(half.columns[0], columns)
        rounded = half.curves[0]
        corner = curve.position(np.array([float(end)]))
        rates = curve.tool_rates(np.concatenate((rounded.position(_S)[:, own], corner)))
        at_corner = rates[-1, :3] @ (line.last if end else line.first)[columns]
        # a line that only turns is fed by its angle (D-30)
        counted = rates[:-1, :3] if length_of(at_corner) > NO_TRAVEL else rates[:-1, 3:]
        speeds = np.linalg.norm(np.einsum("nij,nj->ni", counted, rounded.derivatives(_S)[0][:, own]), axis=1)
        speed = line.feed_speed if math.isfinite(line.feed_speed) else line.feed * curve.max_path_rate
        half.feed = speed / max(BETWEEN_SAMPLES * float(speeds.max()), 1e-300)
        return


def sample_programmed_path(before: Segment, after: Segment, leave: float, join: float) -> Array:
    """Return points of the programmed path around a vertex, which is the middle one, shape (33, K).

    Args:
        leave, join: s on ``before`` and ``after`` at which they begin and end.
    """
    width = len(before.base)
    first = before.sample(np.linspace(leave, before.finish, 17))[0]
    second = after.sample(np.linspace(after.begin, join, 17))[0]
    moved_before, moved_after = _moved(before, width), _moved(after, width)
    first = np.where(moved_before, first, after.base)
    second = np.where(moved_after, second, np.where(moved_before, first[-1], after.base))
    return np.concatenate([first, second[1:]])


def deviation(rounded: Array, programmed: Array, *, straight: bool) -> float:
    """Return the largest distance between two paths around a corner, in either direction [m].

    Args:
        rounded, programmed: weighted points, shape (n, K). straight: the programmed path is two lines.
    """
    # the programmed points are chords of an arc
    chord_error = 0.0 if straight else chord_error_of(programmed)
    return (
        max(max_distance_to_polyline(rounded, programmed), max_distance_to_polyline(programmed, rounded))
        * 1.001
        + chord_error
    )


def chord_error_of(points: Array) -> float:
    """Return the chord error (sagitta) of evenly spaced points on two arcs that meet at the middle point."""
    second = points[2:] - 2.0 * points[1:-1] + points[:-2]
    corner = len(points) // 2 - 1
    second[corner] = 0.0
    return float(np.linalg.norm(second, axis=1).max()) / 8.0
