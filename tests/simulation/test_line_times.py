"""Times of lines noted in columns are the same as those noted one by one."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.simulation.line_times import BLOCK, LineTimes

EDGES = st.lists(st.tuples(st.integers(1, 3 * BLOCK), st.booleans()), max_size=40)


@settings(max_examples=60)
@given(
    edges=EDGES,
    asked=st.lists(st.tuples(st.integers(1, 3 * BLOCK), st.sampled_from((0.0, 0.5, 2.0))), max_size=20),
    split=st.integers(0, 40),
)
def test_columns_are_the_same_as_one_by_one(
    edges: list[tuple[int, bool]], asked: list[tuple[int, float]], split: int
) -> None:
    single, columns = LineTimes(planning=True), LineTimes(planning=True)
    once = dict(asked)
    for each in (single, columns):
        each.bound(2, "axis 0 velocity")
        each.asked(5, 1.0)
    for line, requested in sorted(once.items()):
        single.asked(line, requested)
    columns.asked_in_columns(
        np.array(sorted(once), np.int64), np.array([once[line] for line in sorted(once)])
    )
    for number, (line, ends) in enumerate(edges):
        (single.ended if ends else single.started)(line, number / 8.0)
    lines = np.array([line for line, _ in edges], np.int64)
    ends = np.array([each for _, each in edges], np.bool_)
    times = np.arange(len(edges)) / 8.0
    for part in (slice(0, split), slice(split, None)):
        columns.passed(lines[part], times[part], ends[part])
    assert list(columns.rows()) == list(single.rows())
    assert columns.most_stretched(5) == single.most_stretched(5)
    assert len(columns) == len(single)
    assert columns.stretched_count() == single.stretched_count()
    assert columns.all_marks(9.0, 3 * BLOCK) == single.all_marks(9.0, 3 * BLOCK)


def test_marks_of_a_long_program_come_from_columns_too() -> None:
    single, columns = LineTimes(keep=False), LineTimes(keep=False)
    count = 6 * BLOCK
    lines = np.arange(1, count + 1)
    for line in lines.tolist():
        single.started(line, line - 1.0)
        single.ended(line, float(line))
    for part in np.split(lines, 6):
        both, ends = np.repeat(part, 2), np.tile([False, True], len(part))
        columns.passed(both, both - 1.0 + ends, ends)
    assert columns.marks().through > 3 * BLOCK
    assert columns.all_marks(float(count), count) == single.all_marks(float(count), count)
