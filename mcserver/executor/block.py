"""Blocks of cycles that are played at once on a virtual clock, with the same results as single cycles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Array, Control
from mcserver.motion.kernels.rate_changes import NEAR_U


@dataclass(frozen=True, eq=False)
class LineEvents:
    """`LINE_START` and `LINE_END` events of a program in a slot, in order.

    Attributes:
        line, time: lines and executor times, shape (n,) [s]. ends: True for `LINE_END`.
    """

    program: int
    line: NDArray[np.int64]
    time: Array
    ends: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.line)

    @classmethod
    def none(cls, program: int) -> LineEvents:
        """No event."""
        return cls(program, np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.bool_))

    def line_after(self, line: int) -> int:
        """Return the line under way after these; ``line`` was before."""
        begun = np.flatnonzero(~self.ends)
        since = 0
        if len(begun):
            since = int(begun[-1])
            line = int(self.line[since])
        ended = self.line[since:][self.ends[since:]]
        return 0 if (ended == line).any() else line


@dataclass(frozen=True, eq=False)
class Block:
    """Results of played cycles: lines (n,), setpoints and encoder readings (n, K) [m or rad], values of
    outputs (n, O), and events.
    """

    lines: NDArray[np.int64]
    setpoint: Array
    actual: Array
    outputs: Array
    events: LineEvents


@dataclass(frozen=True, eq=False)
class Passing:
    """Entries that a program passes in a block: line events, and outputs with the index of their cycle."""

    events: LineEvents
    outputs: tuple[tuple[int, Control], ...] = ()


def passing_cycles(u: Array, start: float) -> Array:
    """Return the cycles after ``start``, from 1, in which entries are passed at a rate of 1, shape (n,).

    Args:
        u: of the entries, in order but for rounding, shape (n,) [cycles].
    """
    return np.maximum(1, np.ceil(u - start - NEAR_U))


def passing_times(u: Array, start: float, first: int, cycle_s: float) -> Array:
    """Return the executor times at which entries are passed at a rate of 1, shape (n,) [s].

    Uses the same operations in the same order as single cycles, so that times are bit-identical: a cycle
    begins with 1 left, from which the distance in u to each entry is subtracted.

    Args:
        u: of the entries, in order but for rounding, shape (n,) [cycles]. start: u before the first cycle.
        first: number of that cycle.
    """
    cycle = passing_cycles(u, start)
    left = np.empty(len(u))
    first_of = np.ones(len(u), np.bool_)
    np.not_equal(cycle[1:], cycle[:-1], out=first_of[1:])
    opens = np.flatnonzero(first_of)
    # for each cycle: the next entry to pass, u, and the rest of the cycle
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
