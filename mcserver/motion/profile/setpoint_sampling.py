"""Setpoint rows of a planned run: curves sampled at the cycle and nowhere else."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.row_sampling import locate_samples, sample_lines
from mcserver.motion.lookahead.planned_run import PlannedRun

# Cycles by which a time may miss a whole cycle through rounding.
CYCLE_ROUNDING = 1e-6


@dataclass(frozen=True)
class Rows:
    """Rows at u = first, first + 1, …: positions and velocities (n, K), masks and lines (n,)."""

    first: int
    position: Array
    velocity: Array
    axes: NDArray[np.uint64]
    line: NDArray[np.int64]


def whole_cycle(u: float) -> int:
    """Return the first whole cycle at or after ``u``."""
    return math.ceil(u - CYCLE_ROUNDING)


def first_row(u: float) -> int:
    """Return the first whole cycle after ``u``: a motion's row at its very start would say nothing new."""
    return math.floor(u + CYCLE_ROUNDING) + 1


def sample(run: PlannedRun, origin: float, first: int, last: int, cycle: float) -> Rows:
    """Return rows ``first`` … ``last`` (both included) of a run that starts at u = ``origin`` [cycles]."""
    u = np.arange(first, last + 1, dtype=np.float64)
    time: Array = np.asarray((u - origin) * cycle, dtype=np.float64)
    sigma, speed, index = np.empty(len(u)), np.empty(len(u)), np.empty(len(u), np.intp)
    law = run.phases
    locate_samples(
        time, law.start, law.duration, law.rows, law.end, run.bounds, run.times, sigma, speed, index
    )
    low, high = int(index[0]), int(index[-1]) + 1
    segments = run.segments[low:high]
    position = np.empty((len(u), len(segments[0].base)))
    velocity = np.empty_like(position)
    straight = [each.straight for each in segments]
    here = index - low
    if any(straight):
        curved = np.logical_not(straight)
        lines = np.where(curved[here], -1, here)
        spans = np.array([(each.scale, each.begin, each.finish) for each in segments])
        spans = np.column_stack((run.bounds[low:high], run.bounds[low + 1 : high + 1], spans))
        sample_lines(
            sigma,
            speed,
            lines,
            spans,
            np.array([each.base for each in segments]),
            np.array([each.first for each in segments]),
            np.array([each.end if each.straight else each.base for each in segments]),
            position,
            velocity,
        )
    if not all(straight):
        # segments are in order along time, so equal indices stand together
        cuts = [0, *(np.nonzero(np.diff(here))[0] + 1).tolist(), len(u)]
        for start, stop in pairwise(cuts):
            segment = segments[here[start]]
            if not segment.straight:
                part = slice(start, stop)
                which = int(index[start])
                s = segment.begin + (sigma[part] - run.bounds[which]) / segment.scale
                at_end = sigma[part] >= run.bounds[which + 1]
                s = np.where(at_end, segment.finish, np.clip(s, segment.begin, segment.finish))
                position[part], slope = segment.sample(s)
                velocity[part] = slope * (speed[part, None] / segment.scale)
    axes = np.array([each.active for each in segments], dtype=np.uint64)[here]
    line = np.array([each.line for each in segments], dtype=np.int64)[here]
    return Rows(first, position, velocity, axes, line)
