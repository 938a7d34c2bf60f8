"""Rings: nothing lost, nothing twice, nothing overwritten, in whatever order the two sides run."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.executor.entries import Control, ControlKind, EventKind, ExecutorEvent
from mcserver.executor.shm.event_ring import EventRing
from mcserver.executor.shm.feedback import FeedbackRing, FeedbackRow, SlotState
from mcserver.executor.shm.mailbox import CommandMailbox
from mcserver.executor.shm.rings import ProgramRing, program_ring_size
from mcserver.motion.pieces import LineEdges, Rows


def put(ring: ProgramRing, first: int, count: int) -> None:
    u = np.arange(first, first + count, dtype=float)
    position = np.repeat(u[:, None], ring.axes, axis=1)
    ring.put_rows(Rows(first, position, -position, np.full(count, 1, np.uint64), u.astype(np.int64)))


@settings(max_examples=60)
@given(st.lists(st.tuples(st.booleans(), st.integers(1, 12)), max_size=60))
def test_rows_come_out_once_and_in_order(turns: list[tuple[bool, int]]) -> None:
    buffer = bytearray(program_ring_size(16, 8, 3))
    writer, reader = ProgramRing(buffer, 16, 8, 3), ProgramRing(buffer, 16, 8, 3)
    written = read = 0
    for writes, count in turns:
        if writes:
            count = min(count, writer.row_room())
            if count:
                put(writer, written, count)
            written += count
            continue
        assert reader.rows_written == written
        for _ in range(min(count, written - read)):
            at = read % reader.rows
            assert reader.row_u[at] == reader.row_line[at] == read
            assert np.all(reader.position[at] == read)
            assert np.all(reader.velocity[at] == -read)
            read += 1
            reader.free_rows(read)
        assert writer.row_room() == 16 - (written - read)


@settings(max_examples=60)
@given(st.lists(st.tuples(st.booleans(), st.integers(1, 5)), max_size=60))
def test_control_entries_come_out_as_they_were_put(turns: list[tuple[bool, int]]) -> None:
    ring = ProgramRing(None, 4, 8, 2)
    expected: list[Control] = []
    read = 0
    for writes, count in turns:
        for _ in range(count):
            if writes and ring.control_room():
                number = len(expected)
                values = (number + 0.5, -float(number)) if number % 2 else None
                control = Control(
                    ControlKind(1 + number % 14), number / 4, number, 1 << number % 64, values, 0.1, 3, number
                )
                ring.put_control(control)
                expected.append(control)
            elif not writes and read < ring.controls_written:
                assert ring.control(read) == expected[read]
                read += 1
                ring.free_controls(read)


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 8)), max_size=20))
def test_edges_of_lines_in_columns_are_the_same_entries_as_one_by_one(turns: list[tuple[int, int]]) -> None:
    columns, single = (ProgramRing(None, 8, 8, 2) for _ in range(2))
    number = 0
    for count, read in turns:
        numbers = np.arange(number, number + min(count, columns.control_room()))
        ends = numbers % 2 == 1
        columns.put_edges(LineEdges(numbers / 3.0, numbers, ends), rows=count)
        for each in numbers.tolist():
            kind = ControlKind.LINE_END if each % 2 else ControlKind.LINE_START
            single.put_control(Control(kind, each / 3.0, each), rows=count)
        number += len(numbers)
        assert columns.controls_written == single.controls_written == number
        for each in range(max(0, number - 8), number):
            assert columns.control(each) == single.control(each)
            assert columns.glance(each) == single.glance(each)
        for ring in (columns, single):
            ring.free_controls(max(number - read, number - 8 + ring.control_room()))
    with pytest.raises(OverflowError):
        columns.put_edges(LineEdges(np.full(9, number), np.ones(9, np.int64), np.ones(9, np.bool_)))


def test_edges_in_columns_never_go_back_in_u() -> None:
    ring = ProgramRing(None, 8, 8, 1)
    for places in ([1.0, 0.5], [1.0, 2.0, 1.5]):
        count = len(places)
        edges = LineEdges(np.array(places), np.ones(count, np.int64), np.zeros(count, np.bool_))
        with pytest.raises(ValueError, match="comes after"):
            ring.put_edges(edges)
    assert ring.controls_written == 0


def test_a_full_ring_refuses_and_keeps_what_it_has() -> None:
    ring = ProgramRing(None, 4, 2, 1)
    put(ring, 0, 4)
    with pytest.raises(OverflowError):
        put(ring, 4, 1)
    assert ring.row_u.tolist() == [0, 1, 2, 3]
    for _ in range(2):
        ring.put_control(Control(ControlKind.DWELL, 0.0, 1))
    with pytest.raises(OverflowError):
        ring.put_control(Control(ControlKind.DWELL, 0.0, 1))


def test_u_never_goes_back() -> None:
    ring = ProgramRing(None, 8, 8, 1)
    put(ring, 5, 2)
    with pytest.raises(ValueError, match="comes after"):
        put(ring, 6, 1)
    ring.put_control(Control(ControlKind.DWELL, 4.0, 1))
    with pytest.raises(ValueError, match="comes after"):
        ring.put_control(Control(ControlKind.DWELL, 3.0, 1))
    ring.restart()
    put(ring, 0, 1)


def test_events_keep_their_values_short_and_long() -> None:
    ring = EventRing(None, 3)
    events = [
        ExecutorEvent(EventKind.FAULT, 2, 9, 1.25, 407, 5, 0, (0.1, 0.2)),
        ExecutorEvent(EventKind.SETTLED, 0, 3, 2.5, 0, -1, 77, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        ExecutorEvent(EventKind.LINE_END, 0, 3, 3.0),
    ]
    assert all(ring.put(event) for event in events)
    assert ring.take() == events
    assert ring.take() == []


def test_a_full_event_ring_counts_what_it_loses_and_keeps_the_rest() -> None:
    ring = EventRing(None, 1, events=4)
    kept = [ring.put(ExecutorEvent(EventKind.LINE_END, 0, line, 0.0)) for line in range(6)]
    assert kept == [True] * 4 + [False] * 2
    assert ring.lost == 2
    assert [event.line for event in ring.take()] == [0, 1, 2, 3]


def test_feedback_gives_the_latest_cycle_and_all_since_a_number() -> None:
    ring = FeedbackRing(None, 2, cycles=32)
    row = FeedbackRow(2)
    for cycle in range(100):
        row.setpoint[:] = cycle
        row.set_slot(0, cycle, 1.0, SlotState.RUNNING, 1)
        ring.put(row.row)
    latest = ring.latest()
    assert latest is not None
    assert latest.setpoint.tolist() == [99.0, 99.0]
    assert latest.slots[0].u == 99.0
    first, rows = ring.since(90)
    assert first == 90
    assert ring.block(rows, "setpoint")[:, 0].tolist() == list(range(90, 100))
    first, rows = ring.since(0)
    assert first + len(rows) == 100
    assert ring.block(rows, "setpoint")[0, 0] == first


def test_a_new_program_in_a_slot_starts_with_fresh_requests() -> None:
    mailbox = CommandMailbox(None)
    mailbox.initialise()
    mailbox.open_slot(1, 0b101, (3, 4))
    mailbox.abort(1)
    mailbox.set_override(0.5, 1)
    generation = mailbox.open_slot(1, (1 << 64) - 1, (5, 6), hold=True)
    orders = mailbox.slot_orders(1)
    assert (orders.generation, orders.axes) == (generation, (1 << 64) - 1)
    assert (orders.abort, orders.override, orders.hold) == (0, 1.0, True)
    assert (orders.rows_base, orders.controls_base) == (5, 6)


@pytest.mark.parametrize("ratio", [-0.1, 2.5, float("nan")])
def test_overrides_outside_0_to_200_percent_are_refused(ratio: float) -> None:
    mailbox = CommandMailbox(None)
    with pytest.raises(ValueError, match="override"):
        mailbox.set_override(ratio)
