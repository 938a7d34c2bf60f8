"""Whatever stands in a file of a profile, a check ends with diagnostics, each within its line."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.gcode.program_check import check_program
from tests.corpus.test_corpus import machine_of

WORDS = re.findall(
    r"\S+",
    """
    G0 G1 G2 G4 G10 G28 G28.1 G30 G38.2 G40 G43 G49 G52 G53 G54 G59.3 G92 G92.1 G90 G91 G20 G93 M3 M5 M6
    M30 M0 M83 T1 T99999999999 T1.5 H1.5 H-2 S1000 S-5 X1 Y2 Z-3 A5 E1 P1 P-1 P1.5 P999999999999 L2 L20 R1
    I1 K2 F100 F0 Q1 D1 X G #1=2 [1+2] [6]3 [99]1 % / (a (MSG,x) ;c N O100 *55 , X--1 1.2.3 G1.5 G99999999
    M999 X99999999999999 G1010 G1030 U1 START IF \0 é
    """,
)
LINES = st.lists(st.sampled_from(WORDS), min_size=1, max_size=6).map(" ".join)


@pytest.mark.parametrize("profile", ["cnc", "printer", "robot"])
@settings(max_examples=100)
@given(lines=st.lists(LINES, min_size=1, max_size=3))
def test_a_check_of_garbage_ends_with_places_within_its_lines(profile: str, lines: list[str]) -> None:
    for found in check_program("\n".join(lines), machine_of(profile)):
        assert 0 < found.line <= len(lines)
        assert 0 <= found.column <= len(lines[found.line - 1]) + 1
