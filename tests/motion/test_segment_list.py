"""Segments in columns behave as a list of the same segments does."""

from __future__ import annotations

import math

import hypothesis.strategies as st
import msgspec
import numpy as np
from hypothesis import given

from mcserver.motion.canonical import PathBatch
from mcserver.motion.geometry.batch_segments import segments_of_batch
from mcserver.motion.geometry.path_columns import EVERY, PathColumns
from mcserver.motion.geometry.segment import Segment
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.geometry.segment_rows import SegmentRows

OPERATIONS = ("append", "extend", "run", "set", "drop", "truncate", "copy", "slice")


def run_of(first: int, count: int, active: int = 3, tolerance: float = 0.0) -> SegmentRows:
    points = np.cumsum(np.full((count + 1, 2), 0.01 * first), axis=0)
    lengths = np.full(count, 0.01 * first * math.sqrt(2.0))
    lines = np.arange(first, first + count)
    straight = (np.zeros(count, np.intp), np.full((count, 2), np.nan), np.zeros(count))
    timing = (lengths, lengths, lengths / 0.1, np.full(count, 0.1))
    run = PathBatch(lines, (0, 1), points, ((0, 1),), *straight, *timing, np.full(count, tolerance))
    rows = segments_of_batch(run, {0: 0, 1: 1}, np.ones(2, np.bool_), np.zeros(2), active=active)
    assert rows is not None
    return rows


def objects(first: int, count: int) -> list[Segment]:
    return list(SegmentList.of(run_of(first, count)))


def same_columns(one: PathColumns, other: PathColumns) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True) for name in EVERY)


@given(st.data())
def test_a_list_of_segments_in_columns_changes_as_one_of_objects_does(data: st.DataObject) -> None:
    found, expected = SegmentList(), list[Segment]()
    kept: list[tuple[SegmentList, list[Segment]]] = []
    line = 1
    for operation in data.draw(st.lists(st.sampled_from(OPERATIONS), max_size=30)):
        count = data.draw(st.integers(0, 5))
        at = min(count, len(expected))
        if operation == "append":
            (segment,) = objects(line, 1)
            found.append(segment)
            expected.append(segment)
        elif operation == "extend":
            more = objects(line, count) if count else []
            found.extend(more)
            expected += more
        elif operation == "run" and count:
            found.extend(SegmentList.of(run_of(line, count)))
            expected += list(found[len(expected) :])
        elif operation == "set" and expected:
            index = data.draw(st.integers(-len(expected), len(expected) - 1))
            segment = msgspec.structs.replace(expected[index], begin=0.25, opens=False)
            found[index] = segment
            expected[index] = segment
        elif operation == "drop":
            found.drop(at)
            expected = expected[at:]
        elif operation == "truncate":
            found.truncate(at)
            expected = expected[:at]
        elif operation == "copy":
            kept.append((found.copy(), list(expected)))
        elif operation == "slice":
            kept.append((found[at:], expected[at:]))
        line += 5
    for one, other in [(found, expected), *kept]:
        assert len(one) == len(other)
        # the same objects, however often and in whichever way they are asked for
        assert all(each is segment for each, segment in zip(one, other, strict=True))
        assert all(one[index] is segment for index, segment in enumerate(other))
        if other:
            low = len(other) // 3
            assert same_columns(one.columns(low, len(other)), PathColumns.of(other[low:]))
            assert one.feed_scales().tolist() == [each.feed_scale for each in other]


def test_a_segment_of_a_run_is_the_one_that_its_line_makes() -> None:
    run = run_of(3, 4, 7, 0.02)
    third = SegmentList.of(run)[2]
    assert (third.line, third.mask, third.active, third.tolerance) == (5, 3, 7, 0.02)
    assert third.base.tolist() == run.path.bases[2].tolist()
    assert third.end.tolist() == run.path.ends[2].tolist()
    assert third.straight
    assert third.duration is None
    assert third.requested == float(run.path.requested[2])
