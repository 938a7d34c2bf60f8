"""Bytes to lines (D-01)."""

import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.text.source import decode, split_lines


def test_lf_and_crlf_end_lines() -> None:
    assert split_lines("G20\r\nG21\nM30") == ["G20", "G21", "M30"]


def test_a_lone_cr_ends_no_line() -> None:
    assert split_lines("G20\rG21\n") == ["G20\rG21"]


def test_a_final_line_end_adds_no_line_and_blank_lines_count() -> None:
    assert split_lines("G20\n\nG21\n") == ["G20", "", "G21"]
    assert split_lines("") == []


def test_other_line_separators_of_unicode_end_no_line() -> None:
    assert split_lines("(a\u2028b\x85c\x0bd)\nG20") == ["(a\u2028b\x85c\x0bd)", "G20"]


def test_a_byte_order_mark_is_skipped() -> None:
    assert decode(b"\xef\xbb\xbfG20") == "G20"
    assert split_lines("\ufeffG20") == ["G20"]


def test_a_line_that_is_no_text_gives_a_diagnostic_at_its_byte_0() -> None:
    with pytest.raises(ProgramRejected) as caught:
        decode("G20\n(é) ".encode() + b"\0\xff G21")
    (fault,) = caught.value.diagnostics
    assert (fault.code, fault.line, fault.column, fault.end_column) == ("MC100", 2, 6, 7)


def test_a_line_in_latin_1_leaves_the_other_lines_as_they_are() -> None:
    read = decode("(Größe)\n".encode() + "(Fräser)\n".encode("latin-1"))
    assert read == "(Größe)\n(Fräser)\n"


def test_utf16_is_named() -> None:
    with pytest.raises(ProgramRejected) as caught:
        decode("G20".encode("utf-16"))
    assert "UTF-16" in caught.value.diagnostics[0].hint
