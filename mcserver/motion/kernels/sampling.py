"""Rows of straight segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.path import Array


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
    """Writes position and velocity (n, K) of rows on straight segments; leaves the others alone.

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
        first, last, scale = spans[which, 0], spans[which, 1], spans[which, 2]
        begin, finish = spans[which, 3], spans[which, 4]
        s = begin + (sigma[row] - first) / scale
        s = finish if sigma[row] >= last else min(max(s, begin), finish)
        rate = speed[row] / scale
        for k in range(width):
            # start + (end - start) need not be end in floating point; the target is exact
            position[row, k] = ends[which, k] if s >= 1.0 else starts[which, k] + s * travels[which, k]
            velocity[row, k] = travels[which, k] * rate
