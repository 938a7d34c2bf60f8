"""Sample a planned run at the cycle: setpoint rows."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.path_columns import ARC_KIND, OTHER, STRAIGHT, PathColumns
from mcserver.motion.geometry.segment import columns_of
from mcserver.motion.kernels.arc_segments import ARC
from mcserver.motion.kernels.row_sampling import RowPlaces, SampledSegments, locate_samples, sample_rows
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.pieces import Rows

# Cycles by which a time may miss a whole cycle through rounding.
CYCLE_ROUNDING = 1e-6


def whole_cycle(u: float) -> int:
    """Return the first whole cycle at or after ``u``."""
    return math.ceil(u - CYCLE_ROUNDING)


def first_row(u: float) -> int:
    """Return the first whole cycle after ``u``: a row at a motion's very start would repeat its start."""
    return math.floor(u + CYCLE_ROUNDING) + 1


def sample(
    run: PlannedRun, origin: float, first: int, last: int, cycle: float, path: PathColumns | None = None
) -> Rows:
    """Return rows ``first`` … ``last`` (both included) of a run that starts at u = ``origin`` [cycles].

    Args:
        path: columns of its first segments, if the caller has them already.
    """
    u = np.arange(first, last + 1, dtype=np.float64)
    time: Array = np.asarray((u - origin) * cycle, dtype=np.float64)
    sigma, speed, index = places = RowPlaces(np.empty(len(u)), np.empty(len(u)), np.empty(len(u), np.intp))
    law = run.phases
    locate_samples(time, law.start, law.duration, law.rows, law.end, run.bounds, run.times, places)
    # a row within rounding of the end is at rest: a program held there must not wait for a last trace
    ended = time >= law.duration - CYCLE_ROUNDING * cycle
    sigma[ended], speed[ended] = law.end, 0.0
    low, high = int(index[0]), int(index[-1]) + 1
    known = path is not None and len(path) >= high
    path = path.part(low, high) if path is not None and known else run.segments.columns(low, high)
    position = np.empty((len(u), path.bases.shape[1]))
    velocity = np.empty_like(position)
    here = index - low
    kind = path.kind[here]
    spans = np.column_stack((run.bounds[low:high], run.bounds[low + 1 : high + 1], path.spans))
    sampled = np.where((kind == STRAIGHT) | (kind == ARC_KIND), here, -1)
    if (sampled >= 0).any():
        arcs = np.zeros((len(path), ARC)) if path.arcs is None else path.arcs
        segments = SampledSegments(spans, path.bases, path.travels, path.ends, arcs)
        sample_rows(RowPlaces(sigma, speed, sampled), segments, position, velocity)
    if path.splines:
        _sample_splines(path, spans, here, sigma, speed, position, velocity)
    others = np.flatnonzero(kind == OTHER)
    if len(others):
        # segments are in order along time, so the rows of one stand together
        cuts = [0, *(np.flatnonzero(np.diff(here[others])) + 1).tolist(), len(others)]
        for start, stop in pairwise(cuts):
            part = slice(int(others[start]), int(others[stop - 1]) + 1)
            which = int(index[part.start])
            segment = run.segments[which]
            s = segment.begin + (sigma[part] - run.bounds[which]) / segment.scale
            at_end = sigma[part] >= run.bounds[which + 1]
            s = np.where(at_end, segment.finish, np.clip(s, segment.begin, segment.finish))
            position[part], slope = segment.sample(s)
            velocity[part] = slope * (speed[part, None] / segment.scale)
    return Rows(
        first, position, velocity, path.active[here], path.line[here], feed_scale=path.feed_scale[here]
    )


def put_sample(
    run: PlannedRun, origin: float, first: int, last: int, cycle: float, position: Array, velocity: Array
) -> None:
    """Write the columns that a run of one segment moves, of rows as of `sample`, into arrays (n, K)."""
    rows, moved = sample(run, origin, first, last, cycle), columns_of(run.segments[0].mask)
    position[:, moved], velocity[:, moved] = rows.position[:, moved], rows.velocity[:, moved]


def put_end(run: PlannedRun, position: Array) -> None:
    """Write the columns that a run of one segment moves, at its end, into a position (K,)."""
    moved = columns_of(run.segments[0].mask)
    position[moved] = run.segments[0].sample(np.array([1.0]))[0][0][moved]


def _sample_splines(
    path: PathColumns,
    spans: Array,
    here: NDArray[np.intp],
    sigma: Array,
    speed: Array,
    position: Array,
    velocity: Array,
) -> None:
    """Write the rows on parts of splines, one spline at a time.

    Args:
        path: columns of the m segments that the rows are on. spans: their σ at start and end, scale, begin
            and finish, shape (m, 5). here: index of the segment that each row is on, shape (n,).
        sigma, speed: of each row, shape (n,). position, velocity: written there, shape (n, K).
    """
    assert path.domains is not None
    for spline, columns, first, behind in path.splines:
        start, stop = np.searchsorted(here, (first, behind)).tolist()
        if start == stop:
            continue
        at, part = slice(start, stop), slice(first, behind)
        low = path.domains[part, 0]
        span = path.domains[part, 1] - low
        scale, begin, finish = path.spans[part].T
        begins, ends, rates = low + begin * span, low + finish * span, span / scale
        which = here[at] - first
        t = begins[which] + (sigma[at] - spans[here[at], 0]) * rates[which]
        passed = sigma[at] >= spans[here[at], 1]
        t = np.where(passed, ends[which], np.clip(t, begins[which], ends[which]))
        found = spline.at(t)
        found[0][t >= spline.breaks[-1]] = spline.end
        # columns that the spline does not move rest at each line's base
        position[at], velocity[at] = path.bases[here[at]], 0.0
        position[at, columns] = found[0]
        velocity[at, columns] = found[1] * (rates[which] * speed[at])[:, None]
