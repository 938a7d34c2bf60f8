"""A path cut into the strokes of the program's lines."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from mcserver.plot.scene import Lines, PathTrace

# a stroke shorter than this share of the whole picture is a drive settling, not a motion
LEAST_STROKE = 1e-3


def runs_of(line: Lines) -> list[tuple[int, int, int]]:
    """Stretches of one line as (line, first row, end row)."""
    if len(line) == 0:
        return []
    edges = np.flatnonzero(np.diff(line)) + 1
    bounds = [0, *edges.tolist(), len(line)]
    return [(int(line[first]), first, end) for first, end in itertools.pairwise(bounds)]


def moving_strokes(path: PathTrace) -> list[tuple[int, NDArray[np.float64]]]:
    """Polylines by line; each takes the first point of the next one, so that no gap shows."""
    least = LEAST_STROKE * float(np.ptp(path.setpoint, axis=0).max())
    strokes = [(number, path.setpoint[first : end + 1]) for number, first, end in runs_of(path.line)]
    return [(number, points) for number, points in strokes if float(np.ptp(points, axis=0).max()) > least]
