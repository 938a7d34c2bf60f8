"""Vertices at which a stop might be faster than passing them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.groups import Segments, line_row
from mcserver.motion.kernels.parts import straight_limits
from mcserver.motion.kernels.ramp_kernels import ramp_distance, ramp_time, reachable_speed

# A stop between two lines is tried if a plan takes more than this share of their times from rest to rest.
WORTH = 0.9
# The same for two lines with a T.
LATE = 1.0 + 1e-6


@compiled
def rest_time(length: float, acceleration: float, jerk: float, top: float) -> float:
    """Return the least time from rest to rest over ``length`` [s]; infinite where no motion is possible."""
    peak = reachable_speed(0.0, 0.5 * length, acceleration, jerk, top)
    if not peak > 0.0:
        return math.inf
    ramps = 2.0 * ramp_distance(0.0, peak, acceleration, jerk)
    return 2.0 * ramp_time(0.0, peak, acceleration, jerk) + max(length - ramps, 0.0) / peak


@compiled
def _rest_to_rest_times(segments: Segments, limits: Array) -> Array:
    """Return the times of straight segments from rest to rest, shape (n,) [s].

    The least time, or T if that is longer; infinite for other segments.
    """
    columns = segments.columns
    times = np.full(len(columns.length), math.inf)
    for i in range(len(times)):
        row = line_row(segments, i)
        if row >= 0:
            acceleration, jerk = straight_limits(segments.samples[row], limits)
            times[i] = rest_time(columns.length[i], acceleration, jerk, columns.segment_vmax[i])
            if columns.duration[i] > times[i]:
                times[i] = columns.duration[i]
    return times


@compiled
def slow_vertices(segments: Segments, times: Array, limits: Array) -> NDArray[np.bool_]:
    """Return the segments at whose starts a stop might be as fast, shape (n,).

    Args:
        times: of a plan at the segments' starts and at the end, shape (n+1,) [s].
    """
    rest = _rest_to_rest_times(segments, limits)
    slow = np.zeros(len(rest), np.bool_)
    durations = segments.columns.duration
    for i in range(1, len(rest)):
        if segments.columns.vertex_before[i] != 0:
            # lines that keep their T gain nothing by a stop
            timed = not (math.isnan(durations[i - 1]) or math.isnan(durations[i]))
            share = LATE if timed else WORTH
            slow[i] = times[i + 1] - times[i - 1] > share * (rest[i - 1] + rest[i])
    return slow
