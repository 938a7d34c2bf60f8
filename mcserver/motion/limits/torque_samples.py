"""Add the columns of the joints' torques to samples of segments and vertices."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.geometry.torque_limits import TorqueLimits
from mcserver.motion.kernels.junctions import CRAWL, POLYLINE_TURN, VERTEX_SHARE
from mcserver.motion.kernels.polynomials import limit_of
from mcserver.motion.kernels.sample_limits import CURVATURE_SHARE, TINY, ripple

# Values of s at which the travel of a path's joints is measured.
PROBES = np.linspace(0.0, 1.0, 33)
# Quantities of a column in a sample: |q'|, |q''|, |q'''| and a vertex's |Δq'|, |Δq''|.
QUANTITIES = 5


def torque_places(segment: Segment, least: int, torque: TorqueLimits) -> Array:
    """Return the s at which a segment is sampled, evenly spaced, shape (n,).

    Args:
        least: number of samples that its shape needs.
    """
    probes = PROBES[[0, -1]] if segment.straight else PROBES
    return np.linspace(0.0, 1.0, max(least, torque.count(segment.sample(probes)[0])))


def with_torques(segment: Segment, s: Array, rows: Array, torque: TorqueLimits) -> Array:
    """Return samples of a segment at ``s`` with the torques' columns.

    Args:
        rows: shape (n, 5 K + 2).

    Returns:
        Shape (n, 5 (K + J) + 2).
    """
    width = len(segment.base)
    slope, bend, _ = segment.derivatives(s, width)
    inertial, square = torque.on_path(
        segment.sample(s)[0], slope / segment.scale, bend / segment.scale**2, segment.carried
    )
    still = np.zeros_like(inertial)
    return widen(rows, (inertial, square, still, still, still))


def spline_with_torques(
    parts: list[Segment],
    rows: Array,
    offset: NDArray[np.intp],
    limits: AxisLimits,
    vmax: Array,
    by: NDArray[np.intp],
) -> Array:
    """Return the samples of n parts of a spline with the torques' columns.

    Args:
        rows, offset: their samples, and where those of each begin and end, shape (n+1,). vmax, by: of the
            parts, as `mcserver.motion.kernels.spline_samples.scale_samples` writes them; overwritten.
    """
    assert limits.torque is not None
    found = []
    for index, part in enumerate(parts):
        own = rows[offset[index] : offset[index + 1]]
        found.append(with_torques(part, np.linspace(0.0, 1.0, len(own)), own, limits.torque))
        vmax[index], by[index, 0], by[index, 1] = limit_of(found[-1], limits.of_samples)
    return np.concatenate(found)


def widen(rows: Array, quantities: tuple[Array, ...]) -> Array:
    """Insert J columns into samples (n, 5 K + 2); ``quantities`` are five arrays of shape (n, J)."""
    width = (rows.shape[1] - 2) // QUANTITIES
    parts: list[Array] = []
    for index, values in enumerate(quantities):
        parts += [rows[:, index * width : (index + 1) * width], values]
    return np.hstack([*parts, rows[:, QUANTITIES * width :]])


def vertex_torques(
    before: Segment, after: Segment, scale: float, limits: AxisLimits, torque: TorqueLimits
) -> tuple[float, tuple[Array, ...]]:
    """Return the greatest speed over a junction by torque, and the torques' quantities on both sides.

    The velocity may step by what the torques can change within a cycle, as by max_acceleration·dt (D-36).

    Args:
        scale: of the segment after.

    Returns:
        The speed, infinite where nothing bounds it, 0 for a stop; and the quantities for `widen`, each of
        shape (2, J).
    """
    q = np.tile(after.base, (2, 1))
    slope = np.stack((before.last / before.scale, after.first / scale))
    bend = np.stack((before.d2q_end / before.scale**2, after.d2q_start / scale**2))
    inertial, square = torque.on_path(q, slope, bend, after.carried)
    turned = slope[1] - slope[0]
    steps, _ = torque.on_path(q[:1], turned[None], np.zeros((1, len(turned))), after.carried)
    worst = float(steps.max(initial=0.0))
    largest = np.tile(square.max(axis=0), (2, 1))
    both = np.tile(steps, (2, 1))
    still = np.zeros_like(both)
    speed = math.inf
    if worst > TINY:
        cycle, spacing = limits.cycle, min(before.scale, scale)
        dense = math.sqrt(CURVATURE_SHARE * spacing / worst)
        dense /= math.sqrt(1.0 + ripple(min(1.0, spacing / (dense * cycle))))
        angle = float(np.linalg.norm(turned)) / max(float(np.linalg.norm(slope[0])), TINY)
        polyline = angle < POLYLINE_TURN and spacing < 10.0 * cycle * dense
        speed = min((CURVATURE_SHARE if polyline else VERTEX_SHARE) * cycle / worst, dense)
        # curvature takes its part too: the greatest v with step·v + bend·v² ≤ `CURVATURE_SHARE`
        step, bent = worst / (VERTEX_SHARE * cycle), float(largest.max(initial=0.0))
        speed = min(speed, 2.0 * CURVATURE_SHARE / (step + math.sqrt(step**2 + 4.0 * bent * CURVATURE_SHARE)))
        if not polyline and speed < CRAWL * cycle / max(float(inertial.max()), TINY):
            speed = 0.0
    return speed, (inertial, largest, still, both, still)
