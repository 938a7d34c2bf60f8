"""A program that is read in blocks is the program that is read whole."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcclient.errors import RequestRefused
from mcclient.texts import text_of_program

from mcserver.errors import ProgramRejected
from mcserver.gcode.program_check import MOST_FAULTS, check_lines, check_program
from mcserver.gcode.text.source import MAX_PIECE_BYTES, decode, lines_of, split_lines
from mcserver.machine.machine_file import builtin_text, parse_machine

CARTESIAN = parse_machine(builtin_text("cartesian"))
PIECES = ["G1", "\ufeff", "\r", "\n", "\n", "°", "𝔾", ";"]
FILES = st.lists(st.sampled_from([*(each.encode() for each in PIECES), b"\xe4", b"\x81"]), max_size=60)


def cut(raw: bytes, size: int) -> list[bytes]:
    return [raw[at : at + size] for at in range(0, len(raw), size)]


@given(FILES.map(b"".join), st.integers(1, 20))
def test_blocks_cut_anywhere_give_the_lines_of_the_whole_in_either_code(raw: bytes, size: int) -> None:
    assert list(lines_of(cut(raw, size))) == split_lines(decode(raw))


@given(st.binary(max_size=60) | FILES.map(b"".join))
def test_clients_and_the_server_read_one_text_from_a_file(raw: bytes) -> None:
    try:
        there = text_of_program(raw, "part.nc")
    except RequestRefused:
        with pytest.raises(ProgramRejected, match="MC100"):
            decode(raw)
    else:
        assert there == decode(raw)


@given(st.binary(max_size=60), st.integers(1, 20))
def test_bytes_that_are_no_text_have_the_same_fault(raw: bytes, size: int) -> None:
    try:
        whole = split_lines(decode(raw))
    except ProgramRejected as rejected:
        with pytest.raises(ProgramRejected) as found:
            list(lines_of(cut(raw, size)))
        (here,), (there,) = found.value.diagnostics, rejected.diagnostics
        assert (here.code, here.line, here.column) == (there.code, there.line, there.column)
    else:
        assert list(lines_of(cut(raw, size))) == whole


def test_a_piece_without_a_line_end_does_not_fill_the_memory() -> None:
    def endless() -> list[bytes]:
        return [b"0" * 4096] * 1000

    (line,) = lines_of(endless())
    assert MAX_PIECE_BYTES < len(line) <= MAX_PIECE_BYTES + 4096
    assert [each.code for each in check_lines(iter([line]), CARTESIAN)] == ["MC156"]


def test_a_check_of_a_file_of_another_machine_ends() -> None:
    found = check_program("G1 Q1\n" * (MOST_FAULTS + 100), CARTESIAN)
    assert (found[-1].code, len(found)) == ("MC158", MOST_FAULTS + 1)


def test_a_fault_far_down_a_file_has_its_line() -> None:
    lines = ["G1010", "G1 X1 F600", *(f"X{number % 7}" for number in range(20_000)), "G1 X1e3"]
    found = check_lines(iter(lines), CARTESIAN)
    assert [each.line for each in found if each.severity == "error"] == [len(lines)]
