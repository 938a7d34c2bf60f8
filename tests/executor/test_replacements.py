"""Rows that the executor has not come to are replaced as a whole, or not at all."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.executor.entries import Control, ControlKind, EventKind
from mcserver.executor.shm.rings import ProgramRing, program_ring_size
from mcserver.motion.pieces import LineEdges, Rows
from tests.executor.rig import CYCLE_S, Array, Rig, machine, quintic

MOVE, CUT = 600, 300
LENGTH, FURTHER = 0.1, 0.02


def positions(further: float) -> tuple[Array, Array]:
    """A move to `LENGTH`, and from `CUT` on so much further: as smooth there as it was."""
    share, slope = quintic(np.arange(1, MOVE + 1) / MOVE)
    late = np.clip((np.arange(1, MOVE + 1) - CUT) / (MOVE - CUT), 0.0, 1.0)
    more, rise = quintic(late)
    travelled = LENGTH * share + further * more
    velocity = (LENGTH * slope / MOVE + further * rise / (MOVE - CUT)) / CYCLE_S
    return np.column_stack((travelled, 0.5 * travelled)), np.column_stack((velocity, 0.5 * velocity))


def rows_of(further: float, first: int = 1, last: int = MOVE) -> Rows:
    position, velocity = positions(further)
    part, count = slice(first - 1, last), last - first + 1
    line = np.full(count, 5, np.int64)
    return Rows(first, position[part], velocity[part], np.full(count, 3, np.uint64), line)


def edges(*marks: tuple[float, int, bool]) -> LineEdges:
    u, line, ends = zip(*marks, strict=True) if marks else ((), (), ())
    return LineEdges(np.array(u, float), np.array(line, np.int64), np.array(ends, np.bool_))


def begun(further: float, *marks: tuple[float, int, bool]) -> Rig:
    """A motion all of whose rows have been put, with where lines begin and end on the way."""
    rig = Rig(machine(jerk=200_000.0))
    ring = rig.program.ring
    rig.program.capture()
    rig.program.start_line(5)
    rig.program.control(ControlKind.BEGIN, axes=3)
    ring.put_edges(*(each for each in (edges(*marks).u, edges(*marks).line, edges(*marks).ends)))
    rows = rows_of(further)
    ring.put_rows(rows.first, rows.position, rows.velocity, rows.axes, rows.line)
    return rig


def ended(rig: Rig, line: int) -> Rig:
    rig.program.u, rig.program.line = float(MOVE), line
    rig.program.control(ControlKind.END, axes=3)
    rig.program.control(ControlKind.FINISH)
    rig.run()
    return rig


def until(rig: Rig, u: float) -> None:
    while rig.executor.u(0) < u:
        rig.step()


def ask(rig: Rig, first: int, *marks: tuple[float, int, bool], back: int = 0) -> bool | None:
    """Ask for rows that go further, and let a cycle pass; return the answer."""
    ring = rig.program.ring
    assert ring.ask_replacement(rows_of(FURTHER, first), edges(*marks), back)
    assert ring.replacement_answer() is None
    rig.step()
    return ring.replacement_answer()


def test_replaced_rows_are_played_as_if_they_had_come_first() -> None:
    late = [(400.25, 5, True), (400.25, 6, False), (550.5, 6, True), (550.5, 7, False)]
    rig = begun(0.0, (350.5, 5, True), (350.5, 6, False))
    until(rig, 200.0)
    assert ask(rig, CUT + 1, *late, back=2) is True
    plain = begun(FURTHER, *late)
    ended(rig, 7), ended(plain, 7)
    np.testing.assert_array_equal(rig.setpoint, plain.setpoint)
    assert rig.setpoint[-1, 0] == pytest.approx(LENGTH + FURTHER)
    assert rig.of(EventKind.LINE_END) == plain.of(EventKind.LINE_END)
    assert rig.of(EventKind.LINE_START) == plain.of(EventKind.LINE_START)
    assert not rig.of(EventKind.FAULT)


def test_rows_that_this_cycle_may_come_to_are_not_replaced() -> None:
    rig = begun(0.0)
    until(rig, CUT - 5.0)
    assert ask(rig, CUT + 1) is False
    np.testing.assert_array_equal(ended(rig, 5).setpoint, ended(begun(0.0), 5).setpoint)


def slowed(further: float, u: float = 200.0) -> Rig:
    """A motion in which a change to half the rate has begun at a row, which goes on for some cycles and
    rows."""
    rig = begun(further)
    until(rig, u)
    rig.executor.mailbox.set_override(0.5, 0)
    while rig.executor.executor.rate(0) == 1.0:
        rig.step()
    return rig


def test_rows_that_a_change_of_the_rate_passes_are_replaced_by_such_as_it_keeps_all_limits_on() -> None:
    rig, plain = slowed(0.0), slowed(FURTHER)
    assert ask(rig, int(rig.executor.u(0)) + 13) is True
    np.testing.assert_array_equal(ended(rig, 5).setpoint, ended(plain, 5).setpoint)


# within the limits at the full rate both
@pytest.mark.parametrize(("further", "answer"), [(-1e-3, True), (-0.075, False)])
def test_rows_that_a_change_of_the_rate_passes_are_replaced_only_where_it_keeps_all_limits_on_them(
    further: float, answer: bool
) -> None:
    rig = slowed(0.0, CUT - 16.0)
    assert rig.program.ring.ask_replacement(rows_of(further, CUT + 1), edges(), 0)
    rig.step()
    assert rig.program.ring.replacement_answer() is answer
    ended(rig, 5)
    assert rig.setpoint[-1, 0] == pytest.approx(LENGTH + (further if answer else 0.0))
    assert np.abs(np.diff(rig.setpoint[:, 0], 3)).max() / CYCLE_S**3 <= 200.0 * 1.05


@pytest.mark.parametrize("kind", [ControlKind.OUTPUT, ControlKind.PAUSE, ControlKind.BEGIN])
def test_nothing_but_edges_of_lines_is_replaced(kind: ControlKind) -> None:
    rig = begun(0.0)
    until(rig, 200.0)
    rig.program.u = 400.0
    rig.program.control(kind)
    assert ask(rig, CUT + 1, back=1) is False
    assert rig.program.ring.rows_written == MOVE


def test_a_program_that_is_stopped_keeps_its_rows() -> None:
    rig = begun(0.0)
    until(rig, 200.0)
    rig.executor.mailbox.abort(0)
    assert ask(rig, CUT + 1) is False
    rig.run()
    assert rig.of(EventKind.STOPPED)


def test_motion_in_the_place_of_other_motion_stops_before_its_last_row_where_no_more_come() -> None:
    rig = begun(0.0)
    until(rig, 200.0)
    ring = rig.program.ring
    assert ring.ask_replacement(rows_of(FURTHER, CUT + 1, 500), edges(), 0)
    rig.run_until(EventKind.STARVED)
    rig.step(20)
    assert rig.executor.u(0) <= 500.0
    assert rig.executor.executor.rate(0) == 0.0
    assert np.abs(np.diff(rig.setpoint[:, 0], 2)).max() / CYCLE_S**2 <= 10.0 * 1.01
    assert np.abs(np.diff(rig.setpoint[:, 0], 3)).max() / CYCLE_S**3 <= 200.0 * 1.05


def test_there_is_nothing_to_ask_for_without_room_or_behind_the_reader() -> None:
    rig = begun(0.0)
    until(rig, 200.0)
    ring = rig.program.ring
    assert not ring.ask_replacement(rows_of(FURTHER, 100), edges(), 0)
    assert not ring.ask_replacement(rows_of(FURTHER, CUT + 1), edges(), 9)
    assert ring.last_rows(MOVE + 1, 10) is None
    assert ring.row_at(MOVE + 1) is None
    assert ring.row_at(100) is None
    small = ProgramRing(None, 64, 8, 1)
    put(small, 1, 40)
    assert small.replacement_room(30) < 40
    assert not small.ask_replacement(rows(31, 40, 2.0), edges(), 0)


def rows(first: int, count: int, value: float) -> Rows:
    moved = np.full((count, 1), value)
    return Rows(first, moved, -moved, np.ones(count, np.uint64), np.full(count, int(value), np.int64))


def put(ring: ProgramRing, first: int, count: int) -> None:
    block = rows(first, count, 1.0)
    ring.put_rows(first, block.position, block.velocity, block.axes, block.line)


@settings(max_examples=80, deadline=None)
@given(
    before=st.integers(0, 60),
    count=st.integers(4, 50),
    back=st.integers(1, 48),
    new=st.integers(1, 40),
    marks=st.integers(0, 6),
    old_marks=st.integers(0, 6),
    taken=st.booleans(),
    tried=st.booleans(),
)
def test_a_replacement_is_whole_or_nothing(
    before: int, count: int, back: int, new: int, marks: int, old_marks: int, taken: bool, tried: bool
) -> None:
    buffer = bytearray(program_ring_size(64, 16, 1))
    writer, reader = ProgramRing(buffer, 64, 16, 1), ProgramRing(buffer, 64, 16, 1)
    if before:
        put(writer, 1, before)
        reader.free_rows(before)
    put(writer, before + 1, count)
    last = before + count
    for mark in range(old_marks):
        writer.put_control(Control(ControlKind.LINE_START, float(last), mark))
    first = last - min(back, count - 2) + 1
    held = [reader.row_u.copy(), reader.position.copy(), reader.row_line.copy()]
    new_marks = edges(*((float(first), 90 + each, False) for each in range(marks)))
    if not writer.ask_replacement(rows(first, new, 2.0), new_marks, old_marks):
        assert new > writer.replacement_room(first - 1)
        return
    assert reader.rows_written == last
    if tried:
        reader.try_replacement()
        assert reader.rows_written == first - 1 + new
        assert (reader.position[np.arange(first - 1, first - 1 + new) % 64] == 2.0).all()
    if taken:
        reader.take_replacement()
    else:
        reader.refuse_replacement()
    assert writer.replacement_answer() is taken
    places = np.arange(before, last) % 64
    if not taken:
        assert reader.rows_written == last
        assert reader.controls_written == old_marks
        for now, then in zip((reader.row_u, reader.position, reader.row_line), held, strict=True):
            np.testing.assert_array_equal(now[places], then[places])
        put(writer, last + 1, 1)
        return
    assert reader.rows_written == first - 1 + new
    kept, replaced = np.arange(before, first - 1) % 64, np.arange(first - 1, first - 1 + new) % 64
    assert reader.row_u[kept].tolist() == list(range(before + 1, first))
    assert reader.row_u[replaced].tolist() == list(range(first, first + new))
    assert (reader.position[kept] == 1.0).all()
    assert (reader.position[replaced] == 2.0).all()
    assert (reader.row_line[replaced] == 2).all()
    assert [reader.control(each).line for each in range(reader.controls_written)] == [
        90 + each for each in range(marks)
    ]
    put(writer, first + new, 1)
    assert reader.row_u[(first - 1 + new) % 64] == first + new
