"""Faults of text and grammar: code, columns and remedy (D-01, D-02, D-04)."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.gcode.line_faults import TITLES
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.text.parser import scan_line
from tests.gcode.support import CARTESIAN, Program


def faults(text: str) -> list[tuple[str, int, int]]:
    return [(fault.code, fault.column, fault.end_column) for fault in scan_line(text, 1).faults]


def hints(text: str) -> list[str]:
    return [fault.hint for fault in scan_line(text, 1).faults]


@pytest.mark.parametrize(
    ("text", "expected", "hint"),
    [
        ("GO1 X10", [("MC101", 1, 4)], "write G01"),
        ("GOO X-100", [("MC101", 1, 4)], "write G00"),
        ("G01 XO", [("MC101", 5, 7)], "write X0"),
        ("G01 X1O", [("MC101", 5, 8)], "write X10"),
        ("G01 X1o.5", [("MC101", 5, 10)], "write X10.5"),
        ("G01 [1O]5", [("MC101", 5, 9)], "write [10]"),
        ("693", [("MC103", 1, 4)], "did you mean G93?"),
        ("694 F100", [("MC103", 1, 4)], "did you mean G94?"),
    ],
)
def test_scanning_errors_name_the_character_and_offer_the_remedy(
    text: str, expected: list[tuple[str, int, int]], hint: str
) -> None:
    assert faults(text) == expected
    assert hints(text) == [hint]


def test_the_letter_o_is_named() -> None:
    assert "letter O" in scan_line("GO1 X1", 1).faults[0].message


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G01 X", [("MC102", 5, 6)]),
        ("G01 X.", [("MC102", 5, 7)]),
        ("G01 X-", [("MC102", 5, 7)]),
        ("G01 X--1", [("MC102", 5, 9)]),
        ("G01 X1.2.3", [("MC102", 5, 11)]),
        ("G01 X1-2", [("MC102", 5, 9)]),
        ("G01 X1e5", [("MC102", 5, 9)]),
        ("G01 X1e400", [("MC102", 5, 11)]),
        ("G01 X1E-3 Y2", [("MC102", 5, 10)]),
        ("G01 X- 1", [("MC102", 5, 7), ("MC103", 8, 9)]),
        ("G01 X#5", [("MC102", 5, 8)]),
        ("[64]1", [("MC108", 1, 5)]),
        ("[-1]2", [("MC108", 1, 5)]),
        ("[1.5]3", [("MC108", 1, 6)]),
        ("[]3", [("MC108", 1, 3)]),
        ("[100000000000000000000]3", [("MC108", 1, 24)]),
        ("G01 [3 X5", [("MC102", 5, 7)]),
        ("G01 [3]", [("MC102", 5, 8)]),
        ("G01 3]5", [("MC103", 5, 6), ("MC103", 6, 7), ("MC103", 7, 8)]),
        ("G01 X1 2", [("MC103", 8, 9)]),
        ("G01 Q5", [("MC103", 5, 7)]),
        ("O1000", [("MC103", 1, 6)]),
        ("/G01 X1", [("MC103", 1, 2)]),
        ("#1 = 5", [("MC103", 1, 3), ("MC103", 4, 5), ("MC103", 6, 7)]),
        ("G01 X１２", [("MC105", 6, 7)]),
        ("G01 X\u22125", [("MC105", 6, 7)]),
        ("G01\u00a0X5", [("MC105", 4, 5)]),
        ("G01\x00X5", [("MC105", 4, 5)]),
        ("G01 X5\r", [("MC105", 7, 8)]),
        ("G01 X5\x0b\x0c", [("MC105", 7, 9)]),
        ("é", [("MC105", 1, 2)]),
        ("G01 X10 (open", [("MC106", 9, 10)]),
        ("G01 X10 ) Y1", [("MC106", 9, 10)]),
        ("(a (b) c) G01 X1", [("MC106", 9, 10)]),
        ("G01 X1,", [("MC107", 7, 8)]),
        (",G01 X1", [("MC107", 1, 2)]),
        ("G01 X1, (nothing) ,G01 Y1", [("MC107", 19, 20)]),
        (",", [("MC107", 1, 2), ("MC107", 1, 2)]),
        ("G01.5 X1", [("MC110", 1, 6)]),
        ("G12 X1", [("MC110", 1, 4)]),
        ("G-1 X1", [("MC110", 1, 4)]),
        ("M99", [("MC110", 1, 4)]),
        ("G01 X1 X2", [("MC111", 8, 10)]),
        ("G01 X1 F100 F200", [("MC111", 13, 17)]),
        ("F100 F200", [("MC111", 6, 10)]),
        ("G01 X1 [0]2", [("MC114", 8, 12)]),
        ("G01 X1 U2", [("MC114", 8, 10)]),
        ("G01 [4]1 B2", [("MC114", 10, 12)]),
        ("G01 X1 R5", [("MC112", 8, 10)]),
        ("G01 X1 P2", [("MC112", 8, 10)]),
        ("G00 I5", [("MC112", 5, 7)]),
        ("G04 P1 S2", [("MC103", 8, 10)]),
        ("G04 X1", [("MC112", 5, 7)]),
        ("G1010 X0", [("MC112", 7, 9)]),
        ("G1010 P0 F100", [("MC112", 10, 14)]),
        ("G1020 X1 T3", [("MC112", 10, 12)]),
        ("G1030 X1 F3", [("MC112", 10, 12)]),
        ("M30 P1", [("MC112", 5, 7)]),
        ("G91 P5", [("MC113", 5, 7)]),
        ("I5 J5", [("MC113", 1, 3), ("MC113", 4, 6)]),
        ("X1 G01 Y1", [("MC113", 1, 3)]),
        ("G01 X1 G91 Y1", [("MC113", 12, 14)]),
        ("G00 X1 G01 Y1", [("MC115", 1, 7)]),
        ("G01 X1 G00 Y1", [("MC115", 8, 14)]),
        ("G01 X1 G04 P1", [("MC115", 8, 14)]),
        ("G04 P1 G91", [("MC115", 1, 7)]),
        ("G01 X1 G1020 Y1", [("MC115", 8, 16)]),
        ("G1030 X1 G1040 Y1", [("MC115", 1, 9), ("MC115", 10, 18)]),
        ("G1010 G01 X1", [("MC115", 1, 6)]),
        ("G01 X1, G1010", [("MC115", 9, 14)]),
        ("G1011, G00 X1", [("MC115", 1, 6)]),
        ("X1 G1010", [("MC115", 4, 9)]),
        ("G01 X1 M00 G01 Y1", [("MC115", 8, 11)]),
        ("G01 X1000000001", [("MC116", 5, 16)]),
        ("G01 X" + "9" * 400, [("MC116", 5, 406)]),
        ("G01 X1 N5", [("MC117", 8, 10)]),
        ("N1.5 G20", [("MC117", 1, 5)]),
        ("N-1 G20", [("MC117", 1, 4)]),
        ("% G01 X1", [("MC103", 1, 9)]),
    ],
)
def test_each_fault_has_its_code_and_columns(text: str, expected: list[tuple[str, int, int]]) -> None:
    assert faults(text) == expected


@pytest.mark.parametrize(
    "text",
    [
        "",
        "   \t ",
        "%",
        "  %  ",
        "% title of the program",
        "%O1000",
        "; only a comment ( with everything ) \x00 é",
        "(comment) ; and another",
        "(a ; b) G20",
        "(Kommentar: größer als 5 µm) G20 ; ü",
        "(a (b) G20",
        "N10",
        "N10 G20",
        "n0010g20",
        "g1x5f100",
        "G 1 X 5 F 100",
        "G001 X+1 Y.5 Z5. A-.5",
        "G01 X1 (in between) Y2",
        "\tG01\tX1",
        "G01 [ 6 ]100 [007]5",
        "F100",
        "T3",
        "G94 F30000",
        "G20 F10",
        "G1010 P0 G1010 P1",
        "G90 G91 G20 G21",
        "G01",
        "M30 (end)",
        "G01 X1 M30",
        "M00 G01 X1",
        "G64 P0.1 G01 X10",
        "G1010, G1011",
    ],
)
def test_these_lines_have_no_fault(text: str) -> None:
    assert faults(text) == []


def test_a_simple_line_has_groups_and_columns_too() -> None:
    parsed = scan_line("\tG01  X1 Y-2", 4)
    (group,) = parsed.groups
    (command,) = group
    assert command.spec is not None
    assert command.spec.name == "G01"
    assert parsed.command_span(command) == (2, 13)
    assert [parsed.span(word.index) for word in command.items] == [(7, 9), (10, 13)]


def test_columns_count_code_points_and_tabs_as_one() -> None:
    assert faults("\t(\U0001f600é)\tX--1") == [("MC102", 7, 11)]


def test_all_faults_of_a_line_are_reported_together() -> None:
    found = scan_line("GO1 X--1 Y. [99]1", 12).faults
    assert [fault.code for fault in found] == ["MC101", "MC102", "MC102", "MC108"]
    assert {fault.line for fault in found} == {12}


def test_faults_of_text_and_of_meaning_come_together() -> None:
    assert Program().codes("GO1 X1 F0") == ["MC101", "MC120"]


def test_an_exponent_is_named_and_written_out() -> None:
    (fault,) = scan_line("G01 X1e5", 1).faults
    assert "exponent" in fault.message
    assert fault.hint == "write X100000"


@pytest.mark.parametrize(
    ("text", "name", "hint"),
    [
        ("G01 X\u22125", "MINUS SIGN", "write X-5"),
        ("G01 X\uff11\uff12", "FULLWIDTH DIGIT ONE", "write X12"),
        ("G01 X5\u00a0Y5", "NO-BREAK SPACE", "type a plain space"),
        ("G01\u3000X5", "IDEOGRAPHIC SPACE", "type a plain space"),
        ("G01\x00", "NUL", "take it out"),
        ("G01 X5\r", "carriage return", "lines end at LF or CR LF; a lone CR does not end one"),
    ],
)
def test_characters_outside_the_code_are_named(text: str, name: str, hint: str) -> None:
    (fault,) = scan_line(text, 1).faults
    assert name in fault.message
    assert fault.hint == hint


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("G05", "G04"),
        ("G1021", "G1020"),
        ("G90.1", "whole numbers"),
        ("G92", "work offsets"),
        ("G10", "work offsets"),
        ("G28", "mcctl home"),
        ("M31", "M30"),
        ("G01.5", "whole numbers"),
        ("G54", "work offsets"),
        ("M3", "G1030"),
        ("G" + "1" * 5000, "four digits"),
    ],
)
def test_an_unknown_code_gets_the_nearest_known_one(text: str, hint: str) -> None:
    (fault,) = scan_line(text, 1).faults
    assert fault.code == "MC110"
    assert hint in fault.hint


def test_words_of_an_unknown_code_raise_no_further_fault() -> None:
    assert faults("G28 X0 Y0 S3 P9 I1") == [("MC110", 1, 4), ("MC103", 11, 13)]


def test_a_byte_order_mark_before_the_first_line_is_skipped() -> None:
    assert scan_line("\ufeffG01 X1", 1).faults == ()
    assert [fault.code for fault in scan_line("\ufeffG01 X1", 2).faults] == ["MC105"]


def test_a_byte_order_mark_inside_code_is_named() -> None:
    (fault,) = scan_line("G01 \ufeffX1", 1).faults
    assert fault.code == "MC105"


@pytest.mark.parametrize(
    "text",
    [
        "X1 " * 33000,
        "(" * 100_000,
        "[" * 100_000,
        "1" * 100_000,
        "X" + "1" * 100_000,
        "G" + "0" * 100_000 + "1",
        "[" + "1" * 100_000 + "]1",
        "P1" * 50_000,
        "G64 P" * 20_000,
        "(a(b)c)" * 14_000,
        "," * 100_000,
        "X1é" * 33_000,
    ],
    ids=lambda text: text[:8],
)
@pytest.mark.timeout(20)
def test_long_lines_take_linear_time(text: str) -> None:
    """A reading that is quadratic in any of these takes minutes; the marker ends it."""
    Interpreter(CARTESIAN).check_line(scan_line(text, 1))


GOOD = [
    *("G1", "G01", "G02", "G0", "G04", "G91", "G64", "M30"),
    *("X1", "Y-2.5", "[6]3", "U1", "P2", "F60", "T3", "I1", "R5", "N5", ","),
]
BAD = ["GO1", "X--1", "X", "[64]1", "(c)", ";", "(", ")", "%", "é", "\x00", "1e5", "X1e5"]
WORDS = st.sampled_from([*GOOD, *BAD, " ", "\t"])


@settings(max_examples=300)
@given(
    st.one_of(st.text(max_size=40), st.lists(WORDS, max_size=8).map("".join), st.lists(WORDS).map(" ".join))
)
def test_any_text_is_read_or_refused_with_columns_inside_it(text: str) -> None:
    line = text.replace("\n", " ")
    for fault in Interpreter(CARTESIAN).check_line(scan_line(line, 7))[0]:
        assert fault.code in TITLES
        assert fault.line == 7
        assert 1 <= fault.column < fault.end_column <= len(line) + 1
        assert fault.message
