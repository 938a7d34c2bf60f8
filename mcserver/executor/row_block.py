"""Cycles that are played in one go on a virtual clock, to the same effect as one by one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Array
from mcserver.motion.kernels.rate_changes import NEAR_U


@dataclass(frozen=True, eq=False)
class LineEvents:
    """`LINE_START` and `LINE_END` events of a program in a slot, in order.

    Attributes:
        line, time: their lines and executor times, shape (n,) [s]. ends: which of them are `LINE_END`.
    """

    program: int
    line: NDArray[np.int64]
    time: Array
    ends: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RowBlock:
    """Cycles that were played: lines (n,), setpoints and encoder readings (n, K) [m or rad], and events."""

    lines: NDArray[np.int64]
    setpoint: Array
    actual: Array
    events: LineEvents


def passing_times(u: Array, start: float, first: int, cycle_s: float) -> Array:
    """Return the executor times at which entries are passed at a rate of 1, shape (n,) [s].

    The same operations in the same order as cycle by cycle, so that they are the same to the last bit: at the
    beginning of a cycle 1 of it is left, and each entry that u comes to takes its distance of that.

    Args:
        u: of the entries, in order but for rounding, shape (n,) [cycles]. start: u before the first cycle.
        first: number of that cycle.
    """
    cycle = np.maximum(1, np.ceil(u - start - NEAR_U))
    left = np.empty(len(u))
    opens = np.flatnonzero(np.diff(cycle, prepend=0.0))
    # of each cycle the entry to be passed next, u and what is left of the cycle
    at, ends = opens, np.append(opens[1:], len(u))
    here, remaining = start + cycle[at] - 1.0, np.ones(len(at))
    while len(at):
        there = np.maximum(u[at], here)
        remaining = np.maximum(remaining - (there - here), 0.0)
        left[at] = remaining
        more = at + 1 < ends
        at, ends, here, remaining = at[more] + 1, ends[more], there[more], remaining[more]
    time: Array = (first + cycle - 1.0) * cycle_s - left * cycle_s
    return time
