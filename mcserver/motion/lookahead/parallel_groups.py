"""Plan the comma groups of a line from rest to rest in parallel, and output one stream of rows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from mcserver.motion.bound import Bound, PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.geometry.torque_limits import TorqueLimits
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.setpoint_sampling import first_row, put_end, put_sample
from mcserver.motion.pieces import PIECE, Activation, Deactivation, Piece, Rows

# Shares of the torque limits that each group is planned with, tried until their sum is within the limits.
SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.1, 0.03)
# Most cycles at which the sum of their torques is evaluated.
TORQUE_CYCLES = 20_000
# Greatest share of a torque limit that all groups together may take.
MOST_LOAD = 1.01


def plan_parallel(segments: list[Segment], base: Array, limits: AxisLimits) -> list[PlannedRun | None]:
    """Plan segments that start together, each from rest to rest; None for one that does not travel.

    A joint's torque depends on all of them together: where it would exceed its limit, all become slower.

    Args:
        base: positions of all columns at the start, shape (K,).

    Raises:
        PlanningError: no velocity profile, or the sum exceeds a torque limit at every share.
    """
    torque = limits.torque
    for share in SHARES:
        own = limits
        if torque is not None and share < 1.0:
            own = dataclasses.replace(limits, torque=dataclasses.replace(torque, share=share))
        runs: list[PlannedRun | None] = []
        for segment in segments:
            if not segment.travels:
                runs.append(None)
                continue
            window = Lookahead(own)
            window.append(segment)
            runs.append(window.plan())
        travelling = [run for run in runs if run is not None]
        if torque is None or len(travelling) < 2:
            return runs
        if _load(travelling, base, limits.cycle, torque) <= MOST_LOAD:
            return runs
    raise PlanningError(segments[0].line)


def _load(runs: list[PlannedRun], base: Array, cycle: float, torque: TorqueLimits) -> float:
    """Return the greatest share of a torque limit that runs from rest to rest take together."""
    cycles = math.ceil(max(run.phases.duration for run in runs) / cycle)
    stride = max(1, cycles // TORQUE_CYCLES)
    low = -1
    worst = 0.0
    while low <= cycles:
        high = min(low + PIECE, cycles + 2)
        position = np.tile(base, (high - low + 1, 1))
        velocity = np.zeros_like(position)
        for run in runs:
            put_sample(run, 0.0, low, high, cycle, position, velocity)
        first = (position[2:] - position[:-2]) / (2.0 * cycle)
        second = (position[2:] - 2.0 * position[1:-1] + position[:-2]) / cycle**2
        carried = runs[0].segments[0].carried
        worst = max(
            worst,
            torque.load(position[1:-1][::stride], first[::stride], second[::stride], carried),
        )
        low = high - 1
    return worst


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
            put_sample(run, origin, low, high, cycle, position, velocity)
        count = high - low + 1
        yield Rows(
            low,
            position,
            velocity,
            np.full(count, mask, np.uint64),
            np.full(count, line, np.int64),
            feed_scale=np.full(count, travelling[0].segments[0].feed_scale),
        )
        low = high + 1
    final = base.copy()
    for run in travelling:
        put_end(run, final)
    yield Deactivation(float(last), line, mask, tuple(final.tolist()))


def last_bound(runs: list[PlannedRun | None]) -> Bound | None:
    """Return the limit that stretched the group that ends last."""
    travelling = [run for run in runs if run is not None]
    if not travelling:
        return None
    return max(travelling, key=lambda run: run.phases.duration).bound_by[0]
