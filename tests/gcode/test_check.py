"""All faults of a program in one go, without cascades (D-04)."""

import pytest

from mcserver.gcode.program_check import check_program
from tests.gcode.support import CARTESIAN, check


def test_a_program_without_faults_has_no_diagnostics() -> None:
    assert check("G1010", "G94 F6000", "G01 X10", "G02 X20 Y0 R5", "M30") == []


def test_every_fault_is_found_with_its_line() -> None:
    assert check("GO1 X10 F100", "G01 X--1 Y.", "", "G12", "G01 X9000") == [
        (1, "MC101"),
        (2, "MC102"),
        (2, "MC102"),
        (4, "MC110"),
        (5, "MC201"),
    ]


def test_a_faulty_f_is_not_missed_in_later_lines() -> None:
    assert check("G01 X1 F0", "G01 X2", "G01 X3") == [(1, "MC120")]
    assert check("F--5", "G01 X2", "G01 X3") == [(1, "MC102")]


def test_a_missing_f_is_reported_once_until_it_is_forgotten_again() -> None:
    assert check("G01 X1", "G01 X2", "G93", "G01 X3", "G01 X4") == [(1, "MC121"), (4, "MC121")]


def test_a_missing_motion_code_is_reported_once() -> None:
    assert check("X1", "X2 Y5", "G01 X3 F100") == [(1, "MC113")]


def test_after_a_faulty_move_its_endpoint_counts_as_reached() -> None:
    assert check("F100", "G02 X100 Y0 R30", "G02 X120 Y0 R10") == [(2, "MC104")]
    assert check("F100", "G01 X100 Q5", "G02 X120 Y0 R10") == [(2, "MC103")]
    assert check("F100", "GO1 X1OO", "G02 X120 Y0 R10") == [(2, "MC101"), (2, "MC101")]


def test_where_the_endpoint_is_not_known_nothing_is_concluded_from_it() -> None:
    assert check("F100", "G01 X--100", "G02 X120 Y0 R10", "G02 X140 Y0 R1") == [(2, "MC102"), (4, "MC104")]
    assert check("F100", "G91", "G01 X-e", "G01 X5 Y1", "G90 G01 X5", "G02 X50 Y1 R1") == [
        (3, "MC102"),
        (3, "MC103"),
        (6, "MC104"),
    ]


def test_a_refused_command_says_nothing_about_the_time_of_its_group() -> None:
    assert check("F100", "G02 X100 Y0 R30 G01 [3]5 [4]6") == [(2, "MC104")]


def test_693_is_taken_for_g93() -> None:
    assert check("693 F60", "G01 [3]5 [4]5") == [(1, "MC103")]


def test_what_follows_the_end_is_not_read() -> None:
    assert check("M30", "GO1 X--1") == []


@pytest.mark.parametrize("text", ["", "\n\n", "%\n%", "\ufeffG20"])
def test_empty_programs_and_a_byte_order_mark_are_fine(text: str) -> None:
    assert check_program(text, CARTESIAN) == []


def test_lines_that_end_with_cr_alone_are_a_fault_of_the_file() -> None:
    (fault,) = check_program("; made on an old Mac\rG1010\rG01 X1 F100\r", CARTESIAN)
    assert (fault.code, fault.line, fault.column) == ("MC156", 1, 21)
    assert "CR alone" in fault.message


def test_a_line_beyond_all_bounds_is_a_fault_and_is_not_read() -> None:
    (fault,) = check_program("G1010\n" + "G01 X1 F100 " * 50_000, CARTESIAN)
    assert (fault.code, fault.line) == ("MC156", 2)
    assert "600000 characters" in fault.message


@pytest.mark.parametrize("text", ["", "\n\n", "; nothing\n(nothing)\n%\n"])
def test_a_file_without_code_does_not_pass_in_silence(text: str) -> None:
    (said,) = check_program(text, CARTESIAN, at_rest=True)
    assert (said.code, said.severity) == ("MC157", "warning")
    assert check_program(text + "G21\n", CARTESIAN, at_rest=True) == []
