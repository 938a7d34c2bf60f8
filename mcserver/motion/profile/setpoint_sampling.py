"""Setpoint rows of a planned run: curves sampled at the cycle and nowhere else."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.spline_curve import spline_part
from mcserver.motion.kernels.arc_segments import ARC, sample_arcs
from mcserver.motion.kernels.row_sampling import locate_samples, sample_lines
from mcserver.motion.lookahead.planned_run import PlannedRun

# Cycles by which a time may miss a whole cycle through rounding.
CYCLE_ROUNDING = 1e-6
_NO_ARC = np.zeros(ARC)


@dataclass(frozen=True)
class Rows:
    """Rows at u = first, first + 1, …: positions and velocities (n, K), masks and lines (n,), and what they
    ask of joints whose torques are limited (n, 3, J), see `row_torques`; None without limits. The feed scales
    that they are planned at (n,); None: all 1.
    """

    first: int
    position: Array
    velocity: Array
    axes: NDArray[np.uint64]
    line: NDArray[np.int64]
    torque: Array | None = None
    feed_scale: Array | None = None


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
    # a row that is at the end but for rounding is at rest: who holds there waits for nothing more
    ended = time >= law.duration - CYCLE_ROUNDING * cycle
    sigma[ended], speed[ended] = law.end, 0.0
    low, high = int(index[0]), int(index[-1]) + 1
    segments = run.segments[low:high]
    position = np.empty((len(u), len(segments[0].base)))
    velocity = np.empty_like(position)
    straight = np.array([each.straight for each in segments])
    arcs = np.array([each.arc is not None for each in segments])
    here = index - low
    if straight.any() or arcs.any():
        spans = np.array([(each.scale, each.begin, each.finish) for each in segments])
        spans = np.column_stack((run.bounds[low:high], run.bounds[low + 1 : high + 1], spans))
        starts = np.array([each.base for each in segments])
        travels = np.array([each.first for each in segments])
        ends = np.array([each.end if len(each.end) else each.base for each in segments])
        if straight.any():
            lines = np.where(straight[here], here, -1)
            sample_lines(sigma, speed, lines, spans, starts, travels, ends, position, velocity)
        if arcs.any():
            curved = np.where(arcs[here], here, -1)
            of_arcs = np.array([_NO_ARC if each.arc is None else each.arc for each in segments])
            sample_arcs(sigma, speed, curved, spans, of_arcs, starts, travels, ends, position, velocity)
    if not (straight | arcs).all():
        # segments are in order along time, so equal indices stand together
        of_splines = _sample_splines(run, index, low, high, sigma, speed, position, velocity)
        cuts = [0, *(np.nonzero(np.diff(here))[0] + 1).tolist(), len(u)]
        for start, stop in pairwise(cuts):
            segment = segments[here[start]]
            simple = segment.straight or segment.arc is not None
            if not simple and not of_splines[here[start]]:
                part = slice(start, stop)
                which = int(index[start])
                s = segment.begin + (sigma[part] - run.bounds[which]) / segment.scale
                at_end = sigma[part] >= run.bounds[which + 1]
                s = np.where(at_end, segment.finish, np.clip(s, segment.begin, segment.finish))
                position[part], slope = segment.sample(s)
                velocity[part] = slope * (speed[part, None] / segment.scale)
    axes = np.array([each.active for each in segments], dtype=np.uint64)[here]
    line = np.array([each.line for each in segments], dtype=np.int64)[here]
    feed_scale = np.array([each.feed_scale for each in segments])[here]
    return Rows(first, position, velocity, axes, line, feed_scale=feed_scale)


def _sample_splines(
    run: PlannedRun,
    index: NDArray[np.intp],
    low: int,
    high: int,
    sigma: Array,
    speed: Array,
    position: Array,
    velocity: Array,
) -> list[bool]:
    """Write the rows on parts of splines, all of one spline at once.

    Args:
        index: the segment of each row, shape (n,). low, high: of those that there are rows on.
        sigma, speed: of each row, shape (n,). position, velocity: written there, shape (n, K).

    Returns:
        Which of the segments are parts of splines.
    """
    parts = [spline_part(segment) for segment in run.segments[low:high]]
    first = 0
    for spline, group in groupby(parts, lambda part: None if part is None else part.spline):
        curves = [part for part in group if part is not None]
        if spline is None:
            first = next((i for i in range(first, len(parts)) if parts[i] is not None), len(parts))
            continue
        segments = run.segments[low + first : low + first + len(curves)]
        start, stop = np.searchsorted(index, (low + first, low + first + len(curves))).tolist()
        at = slice(start, stop)
        here = index[at] - (low + first)
        low_t, begin, finish, span, scale = np.array(
            [
                (curve.low, each.begin, each.finish, curve.high - curve.low, each.scale)
                for curve, each in zip(curves, segments, strict=True)
            ]
        ).T
        begins, ends, rates = low_t + begin * span, low_t + finish * span, span / scale
        t = begins[here] + (sigma[at] - run.bounds[index[at]]) * rates[here]
        passed = sigma[at] >= run.bounds[index[at] + 1]
        t = np.where(passed, ends[here], np.clip(t, begins[here], ends[here]))
        found = spline.at(t)
        found[0][t >= spline.breaks[-1]] = spline.end
        columns = segments[0].columns[0]
        # columns beside the spline may rest elsewhere from line to line
        position[at], velocity[at] = np.array([each.base for each in segments])[here], 0.0
        position[at, columns] = found[0]
        velocity[at, columns] = found[1] * (rates[here] * speed[at])[:, None]
        first += len(curves)
    return [part is not None for part in parts]
