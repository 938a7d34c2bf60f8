"""Comma groups: runs on disjoint columns that start together, as one stream of rows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.pieces import PIECE, Activation, Deactivation, Piece
from mcserver.motion.profile.setpoint_sampling import Rows, first_row, sample


def sample_parallel(
    runs: list[PlannedRun | None],
    base: Array,
    origin: float,
    last: int,
    line: int,
    mask: int,
    cycle: float,
) -> Iterator[Piece]:
    """Yield the output of runs that start together at u = ``origin``, through u = ``last`` (D-32).

    Args:
        runs: None for a group that does not travel. base: positions of all columns at the start, shape (K,).
        mask: the columns of all groups.
    """
    yield Activation(origin, line, mask)
    low = first_row(origin)
    travelling = [run for run in runs if run is not None]
    while travelling and low <= last:
        high = min(low + PIECE - 1, last)
        position = np.tile(base, (high - low + 1, 1))
        velocity = np.zeros_like(position)
        for run in travelling:
            part = sample(run, origin, low, high, cycle)
            moved = [column for column in range(len(base)) if run.segments[0].mask >> column & 1]
            position[:, moved] = part.position[:, moved]
            velocity[:, moved] = part.velocity[:, moved]
        count = high - low + 1
        yield Rows(low, position, velocity, np.full(count, mask, np.uint64), np.full(count, line, np.int64))
        low = high + 1
    final = base.copy()
    for run in travelling:
        segment = run.segments[0]
        moved = [column for column in range(len(base)) if segment.mask >> column & 1]
        final[moved] = segment.sample(np.array([1.0]))[0][0][moved]
    yield Deactivation(float(last), line, mask, tuple(final.tolist()))
