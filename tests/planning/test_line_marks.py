"""Marks of the ends of lines: few, and true within what they say."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.planning.line_marks import LineMarks, MarkFitter

LASTING = st.one_of(st.just(0.0), st.floats(1e-3, 2.0), st.floats(10.0, 4000.0))


def fitted(lasting: list[float], most: int) -> tuple[LineMarks, list[float]]:
    fitter, ends = MarkFitter(most), [0.0]
    for line, lasts in enumerate(lasting, start=1):
        ends.append(ends[-1] + lasts)
        fitter.add(line, ends[-1])
    return fitter.marks(ends[-1]), ends


@given(st.lists(LASTING, max_size=400), st.integers(4, 64))
def test_marks_are_few_and_true_within_what_they_say(lasting: list[float], most: int) -> None:
    marks, ends = fitted(lasting, most)
    assert len(marks.lines) <= most + 1
    assert marks.lines == sorted(set(marks.lines))
    for line, end in enumerate(ends):
        assert abs(marks.end_of(line) - end) <= marks.within_s + 1e-6


def test_a_million_alike_lines_are_two_marks() -> None:
    fitter = MarkFitter()
    for line in range(1, 100_001):
        fitter.add(line, 0.25 * line)
    assert fitter.marks(25_000.0).lines == [0, 100_000]


def test_the_next_end_is_that_of_the_next_line_that_takes_time() -> None:
    marks, _ = fitted([0.0, 0.0, 5.0, 0.0, 60.0, 1.0], 64)
    assert [marks.next_end(line) for line in range(7)] == pytest.approx([5, 5, 5, 65, 65, 66, 66], abs=1e-3)


def test_lines_to_come_are_as_quick_as_those_before() -> None:
    marks = LineMarks([0, 10], [0.0, 5.0], 5.0, 10, complete=False).stretched_to(40)
    assert (marks.duration_s, marks.end_of(20)) == (20.0, 10.0)
