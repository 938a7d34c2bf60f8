"""Formatting twice is formatting once, however a text ends."""

from __future__ import annotations

import pytest

from mcserver.language.format import format_program


@pytest.mark.parametrize("text", ["G1", "G1\n", "G1\r\n", "G1\r", "G4 P0.\r", "G3 X0 Y0 I1000 J0 P2 \r"])
def test_a_text_that_is_cut_in_its_last_end_of_line_is_formatted_once(text: str) -> None:
    once = format_program(text)
    assert format_program(once) == once
