"""Rows and control entries reach the rings in order, however little room there is."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mcserver.executor.entries import Control, ControlKind
from mcserver.motion.pieces import LineEdges, Rows
from mcserver.planning.motion_output import Output
from tests.motion.test_laws import law


class NarrowSink:
    """Takes no more than it is given room for, and keeps the order in which things came."""

    def __init__(self) -> None:
        self.rows_free = self.controls_free = 0
        self.taken: list[tuple[str, float]] = []

    def row_room(self) -> int:
        return self.rows_free

    def control_room(self) -> int:
        return self.controls_free

    def put_rows(self, rows: Rows) -> None:
        assert 0 < len(rows) <= self.rows_free
        self.rows_free -= len(rows)
        self.taken += [("row", float(rows.first + index)) for index in range(len(rows))]

    def put_control(self, control: Control, rows: int = 0) -> None:  # noqa: ARG002
        assert self.controls_free > 0
        self.controls_free -= 1
        self.taken.append(("control", control.u))

    def put_zones_ahead(self, zones: int) -> None:
        """Nothing is told apart."""

    def put_edges(self, edges: LineEdges, rows: int = 0) -> None:  # noqa: ARG002
        assert 0 < len(edges) <= self.controls_free
        self.controls_free -= len(edges)
        self.taken += [("control", each) for each in edges.u.tolist()]


def rows(first: int, count: int) -> Rows:
    return Rows(
        first,
        np.zeros((count, 1)),
        np.zeros((count, 1)),
        np.ones(count, np.uint64),
        np.ones(count, np.int64),
    )


def control(u: float) -> Control:
    return Control(ControlKind.LINE_START, u, 1)


def edges(places: list[float]) -> LineEdges:
    return LineEdges(np.array(places), np.ones(len(places), np.int64), np.zeros(len(places), np.bool_))


@given(
    st.lists(st.floats(0.0, 30.0).map(lambda u: round(u, 2)), max_size=20).map(sorted),
    st.integers(1, 30),
    st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=8),
    st.integers(0, 20),
)
@law(100)
def test_an_entry_is_in_the_ring_before_the_row_that_is_played_at_its_u(
    places: list[float], count: int, rooms: list[tuple[int, int]], split: int
) -> None:
    sink = NarrowSink()
    output = Output(sink)
    # some one by one, the others in columns
    for u in places[:split]:
        output.put(control(u))
    for part in (places[split : 2 * split], places[2 * split :]):
        output.put(edges(part))
    output.put(rows(1, count))
    for row_room, control_room in [*rooms, *[(2, 2)] * 40]:
        sink.rows_free, sink.controls_free = row_room, control_room
        output.flush()
    assert not output.blocked
    assert [u for kind, u in sink.taken if kind == "row"] == [float(u) for u in range(1, count + 1)]
    assert [u for kind, u in sink.taken if kind == "control"] == places
    seen = 0.0
    for kind, u in sink.taken:
        if kind == "row":
            seen = u
        else:
            assert u >= seen - 1e-6


def test_many_rows_go_in_one_piece_with_the_entries_between_them() -> None:
    sink = NarrowSink()
    sink.rows_free = sink.controls_free = 100
    output = Output(sink)
    for u in (0.0, 3.5, 7.0):
        output.put(control(u))
    output.put(rows(1, 10))
    assert output.flush()
    assert [kind for kind, _ in sink.taken] == ["control"] * 3 + ["row"] * 10
    assert output.last_u == 10.0


def test_entries_do_not_run_ahead_of_rows_that_find_no_room() -> None:
    sink = NarrowSink()
    sink.rows_free, sink.controls_free = 4, 100
    output = Output(sink)
    for u in (0.0, 3.5, 7.0):
        output.put(control(u))
    output.put(rows(1, 10))
    output.flush()
    assert output.last_u == 4.0
    assert ("control", 7.0) not in sink.taken
    assert output.blocked


def test_what_waits_is_forgotten_when_the_program_is_aborted() -> None:
    output = Output(NarrowSink())
    output.put(control(0.0))
    output.put(rows(1, 3))
    output.drop()
    assert not output.blocked
    assert not output.flush()
