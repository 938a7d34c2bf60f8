"""Corners rounded within a tolerance: a quintic between two segments, with continuous tangent and curvature.

The blend leaves the first segment at a distance d before the vertex and joins the second one at d
behind it. Its Bezier points continue the tangents and bends of both, so that velocity and acceleration
are continuous in every axis. Its largest distance from the programmed path, in either direction, is
measured and d reduced until it fits (D-35, D-36).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.path import Array, PolynomialCurve, SampledCurve
from mcserver.motion.segment import Segment, columns_of

# Share of a segment that a blend at one of its ends may use: two blends never meet.
SHARE = 0.49
# Tangents that nearly oppose each other cannot be rounded: the curve would turn on the spot.
REVERSAL = -0.95
_S = np.linspace(0.0, 1.0, 33)


@dataclass(frozen=True)
class Blend:
    """Two segments with the rounded corner between them, which belongs half to each line."""

    before: Segment
    first: Segment
    second: Segment
    after: Segment


def blend(
    before: Segment, after: Segment, tolerance: float, per_axis: Array, handle_share: float
) -> Blend | None:
    """Rounds the corner between two segments, or None where that is not possible.

    Args:
        tolerance: largest distance from the programmed path [m].
        per_axis: weight of each column in that distance, shape (K,): 1 for metres; for radians what makes a
            degree count as a millimetre.
        handle_share: share of d that a Bezier handle takes at a right angle.
    """
    if not (_can_be_trimmed(before) and _can_be_trimmed(after)):
        return None
    t1 = before.last / math.sqrt(float(before.last @ before.last))
    t2 = after.first / math.sqrt(float(after.first @ after.first))
    if float(t1 @ t2) < REVERSAL:
        return None
    longest = SHARE * min(before.extent, after.extent)
    # the corner of two lines is missed by 0.22 to 0.3 d |t2 - t1|
    miss = 0.22 * float(np.linalg.norm((t2 - t1) * per_axis))
    distance = min(longest, tolerance / miss) if miss > 0.0 else longest
    cosine = float(t1 @ t2)
    handle = handle_share + (0.045 if cosine > 0.0 else 0.13) * cosine
    for _ in range(40):
        made = _make(before, after, distance, handle, per_axis)
        if made is None:
            return None
        found, error = made
        if error <= tolerance:
            break
        distance *= max(0.5, 0.97 * min(1.0, tolerance / error))
    else:
        return None
    return found


def _can_be_trimmed(segment: Segment) -> bool:
    """Lines and arcs under G94; tool paths keep their pose, G93 lines their time."""
    return segment.duration is None and not any(
        isinstance(curve, SampledCurve | PolynomialCurve) for curve in segment.curves
    )


def _make(
    before: Segment, after: Segment, distance: float, handle: float, per_axis: Array
) -> tuple[Blend, float] | None:
    leave = before.finish - distance / before.scale
    join = after.begin + distance / after.scale
    width = len(before.base)
    p0, v0, a0 = _at(before, leave, width)
    p5, v5, a5 = _at(after, join, width)
    # columns that only one of the two moves rest where that one begins or ends
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
    power = _power_basis(np.stack([p0, p1, p2, p3, p4, p5]))[:, columns]
    error = _error(power, before, after, leave, join, columns, per_axis)
    base = after.base
    halves = [
        _segment(_part(power, low, high), columns, mask, side, base)
        for low, high, side in ((0.0, 0.5, before), (0.5, 1.0, after))
    ]
    if any(half is None for half in halves):
        return None
    first, second = halves
    assert first is not None
    assert second is not None
    slope, bend, _ = before.derivatives(np.array([leave]), width)
    trimmed_before = dataclasses.replace(before, finish=leave, last=slope[0], bend_last=bend[0], closes=False)
    slope, bend, _ = after.derivatives(np.array([join]), width)
    trimmed_after = dataclasses.replace(after, begin=join, first=slope[0], bend_first=bend[0], opens=False)
    first.opens = False
    second.closes = False
    return Blend(trimmed_before, first, second, trimmed_after), error


def _moved(segment: Segment, width: int) -> Array:
    return np.array([bool(segment.mask >> column & 1) for column in range(width)])


def _at(segment: Segment, s: float, width: int) -> tuple[Array, Array, Array]:
    """Position, unit tangent and curvature (both with respect to length) at one s."""
    at = np.array([s])
    position = segment.sample(at)[0][0]
    slope, bend, _ = segment.derivatives(at, width)
    speed = math.sqrt(float(slope[0] @ slope[0]))
    return position, slope[0] / speed, bend[0] / speed**2


def _power_basis(points: Array) -> Array:
    """Coefficients, constant first, of the Bezier curve of six points."""
    p0, p1, p2, p3, p4, p5 = points
    return np.stack(
        [
            p0,
            5.0 * (p1 - p0),
            10.0 * (p2 - 2.0 * p1 + p0),
            10.0 * (p3 - 3.0 * p2 + 3.0 * p1 - p0),
            5.0 * (p4 - 4.0 * p3 + 6.0 * p2 - 4.0 * p1 + p0),
            p5 - 5.0 * p4 + 10.0 * p3 - 10.0 * p2 + 5.0 * p1 - p0,
        ]
    )


def _part(power: Array, low: float, high: float) -> Array:
    """The polynomial over [low, high] as one over [0, 1]."""
    degree = len(power) - 1
    result = np.zeros_like(power)
    for k in range(degree + 1):
        for i in range(k, degree + 1):
            result[k] += math.comb(i, k) * low ** (i - k) * (high - low) ** k * power[i]
    return result


def _segment(
    power: Array, columns: NDArray[np.intp], mask: int, side: Segment, base: Array
) -> Segment | None:
    curve = PolynomialCurve(axes=tuple(int(c) for c in columns), coefficients=power, length=0.0)
    slope, bend, _ = curve.derivatives(_S)
    size = np.linalg.norm(slope, axis=1)
    if size.min() <= 1e-3 * size.max():
        return None
    curve = PolynomialCurve(curve.axes, power, float(np.trapezoid(size, _S)))
    width = len(base)
    whole = np.zeros((4, width))
    whole[0, columns], whole[1, columns] = slope[0], slope[-1]
    whole[2, columns], whole[3, columns] = bend[0], bend[-1]
    # the path speed of the line it belongs to is kept where the parameter runs fastest
    feed = side.feed * side.scale / float(size.max())
    return dataclasses.replace(
        side,
        curves=(curve,),
        columns=(columns,),
        mask=mask,
        feed=feed,
        requested=0.0,
        first=whole[0],
        last=whole[1],
        bend_first=whole[2],
        bend_last=whole[3],
        scale=float(size[0]),
        begin=0.0,
        finish=1.0,
        base=base,
        opens=True,
        closes=True,
        straight=False,
    )


def _error(
    power: Array,
    before: Segment,
    after: Segment,
    leave: float,
    join: float,
    columns: NDArray[np.intp],
    per_axis: Array,
) -> float:
    """Largest distance between blend and programmed path, in either direction [m]."""
    weight = per_axis[columns]
    blended = PolynomialCurve((), power, 0.0).position(_S) * weight
    width = len(before.base)
    first = before.sample(np.linspace(leave, before.finish, 17))[0]
    second = after.sample(np.linspace(after.begin, join, 17))[0]
    moved_before, moved_after = _moved(before, width), _moved(after, width)
    first = np.where(moved_before, first, after.base)
    second = np.where(moved_after, second, np.where(moved_before, first[-1], after.base))
    programmed = np.concatenate([first, second[1:]])[:, columns] * weight
    # sampling an arc by 16 chords misses its bow by this much
    bow = 0.0 if before.straight and after.straight else _bow(programmed)
    return max(_farthest(blended, programmed), _farthest(programmed, blended)) * 1.001 + bow


def _bow(points: Array) -> float:
    second = points[2:] - 2.0 * points[1:-1] + points[:-2]
    corner = len(points) // 2 - 1
    second[corner] = 0.0
    return float(np.linalg.norm(second, axis=1).max()) / 8.0


def _farthest(points: Array, polyline: Array) -> float:
    """Largest distance of ``points`` from a polyline."""
    start, travel = polyline[:-1], np.diff(polyline, axis=0)
    length = np.maximum((travel * travel).sum(axis=1), 1e-300)
    away = points[:, None, :] - start[None, :, :]
    along = np.clip((away * travel).sum(axis=2) / length, 0.0, 1.0)
    gap = away - along[:, :, None] * travel
    return float(np.sqrt((gap * gap).sum(axis=2).min(axis=1).max()))
