"""Times of entries of a block of rows: the same to the bit as cycle by cycle."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.executor.block import passing_times
from mcserver.motion.kernels.rate_changes import NEAR_U

CYCLE_S = 0.001


def one_by_one(u: list[float], start: float, first: int) -> list[float]:
    """What `ProgramSlot.advance` does at a rate of 1, entry by entry."""
    times = []
    passed, left, here = 0, 1.0, start
    for each in u:
        number = max(1, math.ceil(each - start - NEAR_U))
        if number != passed:
            passed, left, here = number, 1.0, start + number - 1.0
        if each > here:
            left = max(0.0, left - (each - here))
            here = each
        times.append((first + number - 1) * CYCLE_S - left * CYCLE_S)
    return times


@settings(max_examples=200)
@given(
    steps=st.lists(
        st.one_of(st.just(0.0), st.floats(0.0, 2.5), st.floats(0.0, 3e-9), st.just(1.0)),
        max_size=60,
    ),
    start=st.integers(0, 10**7),
    first=st.integers(0, 10**9),
)
def test_entries_are_passed_at_the_same_times_as_one_by_one(
    steps: list[float], start: int, first: int
) -> None:
    u = float(start) + np.cumsum(np.array(steps))
    found = passing_times(u, float(start), first, CYCLE_S)
    assert found.tolist() == one_by_one(u.tolist(), float(start), first)
