"""States of a velocity profile at given times, and setpoint rows of straight segments and arcs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled


class RowPlaces(NamedTuple):
    """Coordinate along σ, speed and segment of n rows, shape (n,) each."""

    sigma: Array
    speed: Array
    segment: NDArray[np.intp]


class SampledSegments(NamedTuple):
    """The data of m straight segments and arcs in K columns that setpoints are sampled from.

    Attributes:
        spans: σ at start and end, scale, and begin and finish of s, shape (m, 5).
        starts, ends: positions. travels: dp/ds of columns that move linearly, shape (m, K).
        arcs: rows of `mcserver.motion.kernels.arc_segments`, shape (m, `ARC`).
    """

    spans: Array
    starts: Array
    travels: Array
    ends: Array
    arcs: Array


@compiled
def sample_rows(places: RowPlaces, segments: SampledSegments, position: Array, velocity: Array) -> None:
    """Write position and velocity (n, K) of rows on straight segments and arcs.

    Rows with a segment below 0 are left alone.
    """
    spans, starts, travels, ends, arcs = segments
    for row in range(len(places.segment)):
        which = places.segment[row]
        if which < 0:
            continue
        sigma, span, arc = places.sigma[row], spans[which], arcs[which]
        s = span[4]
        if sigma < span[1]:
            s = min(max(span[3] + (sigma - span[0]) / span[2], span[3]), span[4])
        rate = places.speed[row] / span[2]
        for k in range(starts.shape[1]):
            # the programmed ends are exact, despite the rounding of start + (end - start), cos and sin
            position[row, k] = ends[which, k] if s >= 1.0 else starts[which, k] + s * travels[which, k]
            velocity[row, k] = travels[which, k] * rate
        sweep, growth = arc[5], arc[7]
        if sweep == 0.0:
            continue
        one, other = int(arc[0]), int(arc[1])
        angle, radius = arc[4] + sweep * s, arc[6] + growth * s
        cos, sin = math.cos(angle), math.sin(angle)
        if s < 1.0:
            position[row, one] = arc[2] + radius * cos if s > 0.0 else starts[which, one]
            position[row, other] = arc[3] + radius * sin if s > 0.0 else starts[which, other]
        velocity[row, one] = (growth * cos - radius * sweep * sin) * rate
        velocity[row, other] = (growth * sin + radius * sweep * cos) * rate


@compiled
def locate_samples(
    time: Array,
    start: Array,
    duration: float,
    rows: Array,
    end: float,
    bounds: Array,
    times: Array,
    places: RowPlaces,
) -> None:
    """Write ``places`` at times that increase, shape (n,) [s].

    Args:
        start, rows: of each phase, shape (m,) and (m, `PHASE`). end: the last coordinate. bounds, times: of
            the segments' ends, shape (k+1,).
    """
    sigma, speed, index = places
    phase, by_place, by_time = 0, 0, 0
    last = len(bounds) - 2
    for row in range(len(time)):
        t = min(max(time[row], 0.0), duration)
        while phase < len(start) - 1 and start[phase + 1] <= t:
            phase += 1
        x = t - start[phase]
        v, a, j = rows[phase, 2], rows[phase, 3], rows[phase, 4]
        here = rows[phase, 1] + x * (v + x * (a / 2.0 + x * j / 6.0))
        done = time[row] >= duration
        sigma[row] = end if done else min(here, end)
        speed[row] = max(v + x * (a + x * j / 2.0), 0.0)
        while by_place < last and bounds[by_place + 1] <= sigma[row]:
            by_place += 1
        # near a stop σ is rounded: whether a junction has been passed is decided by time
        while by_time < last and times[by_time + 1] <= time[row]:
            by_time += 1
        index[row] = last if done else min(by_place, by_time)
