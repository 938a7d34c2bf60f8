"""Limits along a path coordinate σ as a function of speed.

With q(σ) the path, q̇ = q'σ̇, q̈ = q'σ̈ + q''σ̇² and q⃛ = q'σ⃛ + 3q''σ̇σ̈ + q'''σ̇³. At a speed v each axis
leaves |q'|·A ≤ a - |q''|v² for acceleration along the path, and likewise for jerk. A vertex of a polyline is
a step of the tangent by D: sampled at the cycle it takes the acceleration D·v·max(1/dt, v/ℓ), ℓ being the
length of the adjacent segments (several vertices may fall into one cycle). D-36 defines limits this way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mcserver.motion.geometry.curves import POLYNOMIAL_SAMPLES, Array
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.geometry.spline_curve import spline_part
from mcserver.motion.kernels.arc_segments import arc_samples
from mcserver.motion.kernels.junctions import PrecedingEnd, junction_vmax_of, line_sample
from mcserver.motion.kernels.polynomials import KINDS, limit_of, polynomial_samples
from mcserver.motion.limits.torque_samples import torque_places, vertex_torques, widen, with_torques


class SpeedLimit(NamedTuple):
    """Greatest speed along σ and what bounds it: (column, "velocity" | "acceleration" | "jerk")."""

    velocity: float
    column: int
    kind: str


def sample_rows(dq: Array, d2q: Array, d3q: Array) -> Array:
    """Pack a path's derivatives, shape (m, K), into rows of `mcserver.motion.kernels.sample_limits`."""
    count, width = dq.shape
    rows: Array = np.zeros((count, 5 * width + 2))
    np.abs(dq, out=rows[:, :width])
    np.abs(d2q, out=rows[:, width : 2 * width])
    np.abs(d3q, out=rows[:, 2 * width : 3 * width])
    rows[:, 5 * width :] = math.inf
    return rows


def samples_of(segment: Segment, limits: AxisLimits) -> tuple[Array, SpeedLimit]:
    """Return a segment's samples by σ = s·scale, and the greatest constant speed on them."""
    width = len(limits.velocity)
    if limits.torque is None:
        if segment.straight:
            rows = np.zeros((1, 5 * width + 2))
            velocity, column = line_sample(segment.first, segment.scale, limits.rows, rows)
            return rows, SpeedLimit(velocity, column, "velocity")
        if segment.arc is not None:
            rows = np.zeros((int(segment.arc[-1]), 5 * width + 2))
            velocity, column, kind = arc_samples(segment.arc, segment.first, segment.scale, limits.rows, rows)
            return rows, SpeedLimit(velocity, column, KINDS[kind])
        own = segment.curves[0].power
        if own is not None:
            power = np.zeros((len(own), width))
            power[:, segment.columns[0]] = own
            rows = np.zeros((POLYNOMIAL_SAMPLES, 5 * width + 2))
            polynomial_samples(power, segment.scale, rows, np.empty(POLYNOMIAL_SAMPLES))
            return rows, speed_limit(rows, limits)
        s = _places(segment)
    elif spline_part(segment) is not None:
        s = segment.curves[0].samples()
    else:
        s = torque_places(segment, 1 if segment.straight else len(_places(segment)), limits.torque)
    scale = segment.scale
    rows = sample_rows(*(each / scale**order for order, each in enumerate(segment.derivatives(s, width), 1)))
    if limits.torque is not None:
        rows = with_torques(segment, s, rows, limits.torque)
    return rows, speed_limit(rows, limits)


def _places(segment: Segment) -> Array:
    """Return the s at which a segment's limits are sampled: its curve's; with several bent curves, the most
    that one of them needs, evenly.
    """
    places = [curve.samples() for curve in segment.curves if not curve.straight]
    most = max(places, key=len)
    return most if len(places) == 1 else np.linspace(0.0, 1.0, len(most))


def speed_limit(rows: Array, limits: AxisLimits) -> SpeedLimit:
    """Return the greatest constant speed that the axes allow on samples, without their vertices."""
    velocity, column, kind = limit_of(rows, limits.of_samples)
    return SpeedLimit(velocity, column, KINDS[kind])


@dataclass(frozen=True)
class Junction:
    """Speed over the junction of two segments.

    Attributes:
        speed: greatest speed over the junction. scale: of the segment after it, so that speed is continuous.
        samples: of the vertex, for the segment before and after, shape (2, 5 K + 2); None where the vertex
            limits nothing, or the motion stops.
    """

    speed: float
    scale: float
    samples: Array | None


def junction(before: Segment, after: Segment, limits: AxisLimits) -> Junction:
    """Return the speed over the junction of two segments (D-35, D-36).

    The velocity of an axis may step by max_acceleration·dt, its acceleration by max_jerk·dt. Where that
    leaves less than a crawl, the motion stops: a stop costs hardly more and keeps the jerk limit too. The
    velocity may not step beyond the jerk limit where a tolerance allows to round the vertex, nor at the end
    of a smoothed curve, whose tangent need not be that of the line that it replaces.
    """
    of_curve = spline_part(before) is not None
    samples = np.zeros((2, 5 * len(before.last) + 2))
    speed, scale = junction_vmax_of(
        PrecedingEnd(
            before.last, before.d2q_end, before.scale, before.may_be_split and limits.torque is None
        ),
        after.first,
        after.d2q_start,
        limits.rows,
        limits.cycle,
        after.may_be_split,
        after.tolerance > 0.0 or of_curve,
        samples,
    )
    if scale == 0.0:
        return Junction(0.0, after.scale, None)
    if limits.torque is not None and speed > 0.0:
        by_torque, quantities = vertex_torques(before, after, scale, limits, limits.torque)
        speed = min(speed, by_torque)
        samples = widen(samples, quantities)
        samples[:, -2], samples[:, -1] = min(before.scale, scale), speed
    return Junction(speed, scale, None if math.isinf(speed) or speed <= 0.0 else samples)
