"""Zones of long segments: a vertex takes acceleration only near it.

A second difference spreads a step of velocity over two cycles, a third one over three (D-36). Further away
from the vertex all of the acceleration is available along the path.
"""

from __future__ import annotations

import math

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Length of a vertex zone in time [cycles].
NEAR = 3.0
# A segment is split if it is at least this many times as long as its vertex zones together,
LONG = 4.0
# or this many times, if on it the square of speed can rise by twice its value at the vertices.
SLOW = 2.0


@compiled
def vertex_zone_length(speed: float, acceleration: float, cycle: float) -> float:
    """Return the length of the zone of a vertex that is passed with at most ``speed`` [m or rad along σ].

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
        before, after: lengths of the vertex zones at its start and end; 0 without a vertex.
        acceleration: the greatest along it. speed: the greater of its vertices' speed limits.
    """
    near = before + after
    return length >= LONG * near or (length >= SLOW * near and acceleration * length >= speed * speed)
