"""Setpoint rows of a planned run: the curves sampled at the cycle and nowhere else."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.lookahead import PlannedRun
from mcserver.motion.path import Array

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
    """The first whole cycle at or after ``u``."""
    return math.ceil(u - CYCLE_ROUNDING)


def first_row(u: float) -> int:
    """The first whole cycle after ``u``: a motion's row at its very start would say nothing new."""
    return math.floor(u + CYCLE_ROUNDING) + 1


def sample(run: PlannedRun, origin: float, first: int, last: int, cycle: float) -> Rows:
    """Rows ``first`` … ``last`` (both included) of a run that starts at u = ``origin`` [cycles]."""
    u = np.arange(first, last + 1, dtype=np.float64)
    time: Array = np.asarray((u - origin) * cycle, dtype=np.float64)
    sigma, speed = run.phases.at(time)
    index = np.clip(np.searchsorted(run.bounds, sigma, side="right") - 1, 0, len(run.segments) - 1)
    # a joint at which the motion stops is reached for good only after the stop: take the times there
    index = np.minimum(
        index, np.clip(np.searchsorted(run.times, time, side="right") - 1, 0, len(run.segments) - 1)
    )
    index[time >= run.phases.duration] = len(run.segments) - 1
    width = len(run.segments[0].base)
    position = np.empty((len(u), width))
    velocity = np.empty((len(u), width))
    axes = np.empty(len(u), dtype=np.uint64)
    line = np.empty(len(u), dtype=np.int64)
    # segments are in order along time, so equal indices stand together
    cuts = np.concatenate([[0], np.nonzero(np.diff(index))[0] + 1, [len(u)]])
    for low, high in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
        which = int(index[low])
        segment = run.segments[which]
        s = segment.begin + (sigma[low:high] - run.bounds[which]) / segment.scale
        at_end = sigma[low:high] >= run.bounds[which + 1]
        s = np.where(at_end, segment.finish, np.clip(s, segment.begin, segment.finish))
        points, slope = segment.sample(s)
        position[low:high] = points
        velocity[low:high] = slope * (speed[low:high, None] / segment.scale)
        axes[low:high] = segment.active
        line[low:high] = segment.line
    return Rows(first, position, velocity, axes, line)
