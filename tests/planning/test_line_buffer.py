"""The queue of a program's text."""

from __future__ import annotations

import pytest

from mcserver.errors import ProgramRejected
from mcserver.planning.line_buffer import MAX_LINE_LENGTH, LineBuffer


def test_lines_come_out_in_order_and_are_counted() -> None:
    buffer = LineBuffer()
    buffer.put(5, ["a", "b"])
    buffer.put(7, ["c"])
    assert buffer.run(10) == ["a", "b", "c"]
    assert buffer.take() == (5, "a")
    buffer.drop(2)
    assert (len(buffer), buffer.consumed) == (0, 7)


def test_a_run_ends_before_a_gap_in_the_numbers() -> None:
    buffer = LineBuffer()
    buffer.put(1, ["a", "b"])
    buffer.put(3, ["c"])
    buffer.put(5, ["e", "f"])
    assert buffer.run(10) == ["a", "b", "c"]
    assert buffer.run(1) == ["a"]
    buffer.drop(3)
    assert (buffer.consumed, buffer.next_number, buffer.run(10)) == (3, 5, ["e", "f"])
    assert buffer.take() == (5, "e")
    assert (len(buffer), buffer.run(10)) == (1, ["f"])


@pytest.mark.parametrize("text", ["x" * (MAX_LINE_LENGTH + 1), "G01 X1\nG01 X2", "G01\r"])
def test_what_is_no_line_is_refused_where_it_stands(text: str) -> None:
    buffer = LineBuffer()
    buffer.put(1, ["G01 X1", text, "G01 X3"])
    assert buffer.run(10) == ["G01 X1"]
    buffer.take()
    assert buffer.run(10) == []
    with pytest.raises(ProgramRejected) as rejected:
        buffer.take()
    assert (rejected.value.code, rejected.value.diagnostics[0].line) == ("MC513", 2)
    assert buffer.take() == (3, "G01 X3")


def test_in_single_line_mode_each_step_releases_one_line() -> None:
    buffer = LineBuffer()
    buffer.single_line = True
    buffer.put(1, ["a", "b"])
    assert (buffer.ready, buffer.run(5)) == (0, [])
    buffer.step()
    assert (buffer.ready, buffer.take()) == (1, (1, "a"))
    assert buffer.ready == 0


def test_a_closed_buffer_takes_nothing() -> None:
    buffer = LineBuffer()
    buffer.closed = True
    buffer.put(1, ["a"])
    assert len(buffer) == 0
