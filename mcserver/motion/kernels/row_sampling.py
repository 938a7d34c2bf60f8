"""States of a velocity profile at given times, and setpoint rows of straight segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled


@compiled
def share_of(sigma: float, span: Array) -> float:
    """Return the share of its curve that a segment has passed at a coordinate.

    Args:
        span: shape (5,), a row of those of `sample_lines`.
    """
    if sigma >= span[1]:
        return float(span[4])
    passed = span[3] + (sigma - span[0]) / span[2]
    return float(min(max(passed, span[3]), span[4]))


@compiled
def sample_lines(
    sigma: Array,
    speed: Array,
    index: NDArray[np.intp],
    spans: Array,
    starts: Array,
    travels: Array,
    ends: Array,
    position: Array,
    velocity: Array,
) -> None:
    """Write position and velocity (n, K) of rows on straight segments; leave the others alone.

    Args:
        sigma, speed: of each row, shape (n,). index: each row's segment; below 0 it is not straight.
        spans: of each segment σ at its start and end, its scale, and the shares between which it is passed,
            shape (m, 5). starts, travels, ends: shape (m, K).
    """
    width = starts.shape[1]
    for row in range(len(sigma)):
        which = index[row]
        if which < 0:
            continue
        s = share_of(sigma[row], spans[which])
        rate = speed[row] / spans[which, 2]
        for k in range(width):
            # start + (end - start) need not be end in floating point; the target is exact
            position[row, k] = ends[which, k] if s >= 1.0 else starts[which, k] + s * travels[which, k]
            velocity[row, k] = travels[which, k] * rate


@compiled
def locate_samples(
    time: Array,
    start: Array,
    duration: float,
    rows: Array,
    end: float,
    bounds: Array,
    times: Array,
    sigma: Array,
    speed: Array,
    index: NDArray[np.intp],
) -> None:
    """Write coordinate, speed and segment at times that increase, shape (n,) each [s].

    Args:
        start, rows: of each phase, shape (m,) and (m, `PHASE`). end: the last coordinate. bounds, times: of
            the segments' ends, shape (k+1,).
        sigma, speed, index: written.
    """
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
        # a joint at which the motion stops is reached for good only after the stop: the times say when
        while by_time < last and times[by_time + 1] <= time[row]:
            by_time += 1
        index[row] = last if done else min(by_place, by_time)
