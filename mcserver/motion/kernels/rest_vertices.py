"""Vertices at which a stop might be quicker than to pass them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.groups import BEFORE, EXTENT, TOP, Columns, line_row
from mcserver.motion.kernels.parts import straight_limits
from mcserver.motion.kernels.ramp_kernels import change_distance, change_time, reachable_speed

# Two lines that take this share of their times from rest to rest are tried with a stop between them.
WORTH = 0.9


@compiled
def rest_time(length: float, acceleration: float, jerk: float, top: float) -> float:
    """Least time from rest to rest over ``length`` [s]; infinite where there is no way to move."""
    peak = reachable_speed(0.0, 0.5 * length, acceleration, jerk, top)
    if not peak > 0.0:
        return math.inf
    ramps = 2.0 * change_distance(0.0, peak, acceleration, jerk)
    return 2.0 * change_time(0.0, peak, acceleration, jerk) + max(length - ramps, 0.0) / peak


@compiled
def _rest_times(nodes: Columns, limits: Array) -> Array:
    """Of each straight segment without a time of its own; of others infinite. Shape (n,) [s]."""
    numbers = nodes.numbers
    times = np.full(len(numbers), math.inf)
    for i in range(len(numbers)):
        row = line_row(nodes, i)
        if row >= 0:
            acceleration, jerk = straight_limits(nodes.rows[row], limits)
            times[i] = rest_time(numbers[i, EXTENT], acceleration, jerk, numbers[i, TOP])
    return times


@compiled
def slow_vertices(nodes: Columns, times: Array, limits: Array) -> NDArray[np.bool_]:
    """At the starts of which segments the motion might as well stop, shape (n,).

    Args:
        times: of a plan at the segments' starts and at the end, shape (n+1,) [s].
    """
    rest = _rest_times(nodes, limits)
    slow = np.zeros(len(rest), np.bool_)
    for i in range(1, len(rest)):
        if nodes.marks[i, BEFORE] != 0:
            slow[i] = times[i + 1] - times[i - 1] > WORTH * (rest[i - 1] + rest[i])
    return slow
