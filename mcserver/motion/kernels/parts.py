"""Zones of long segments: what a vertex demands holds near it only.

A second difference spreads a step of velocity over two cycles, a third one over three (D-36). Further away
from the vertex all of the acceleration is there for the way along the path.
"""

from __future__ import annotations

import math

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Cycles from a vertex up to which it takes its part.
NEAR = 3.0
# A segment is in parts if it is at least so many times as long as those near its vertices; the lower number
# if it leaves room for twice the square of their speed, since else there is little to gain.
LONG, SLOW = 4.0, 2.0


@compiled
def vertex_zone_length(speed: float, acceleration: float, cycle: float) -> float:
    """Return the distance from a vertex passed with at most ``speed`` within which its demand counts [m or
    rad along σ].

    Args:
        acceleration: the greatest along the segment.
    """
    time = NEAR * cycle
    return time * (speed + 0.5 * acceleration * time)


@compiled
def straight_limits(row: Array, limits: Array) -> tuple[float, float]:
    """Return the greatest acceleration and jerk along a straight segment, from its one sample (5 K + 2,)."""
    acceleration = jerk = math.inf
    for k in range(limits.shape[1]):
        if row[k] > 0.0:
            acceleration = min(acceleration, limits[1, k] / row[k])
            jerk = min(jerk, limits[2, k] / row[k])
    return acceleration, jerk


@compiled
def is_split(length: float, before: float, after: float, acceleration: float, speed: float) -> bool:
    """Return whether a segment is planned in zones.

    Args:
        before, after: how far the vertices at its start and end reach; 0: there is none.
        acceleration: the greatest along it. speed: the greater one of its vertices.
    """
    near = before + after
    return length >= LONG * near or (length >= SLOW * near and acceleration * length >= speed * speed)
